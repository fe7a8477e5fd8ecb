"""Training of preset ``paper`` beside what its authors released of theirs: 100 places, two traverses, three epochs."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from lava_vpr import train
from lava_vpr.config import preset
from lava_vpr.encoding import Keep, encode_arrays
from lava_vpr.engine.conductance.model import ConductanceState
from lava_vpr.recognition import Comparison, recognise
from lava_vpr.synthetic.world import World, render

SPIKES, THETA_MV = 17.12, 39.9
"""Mean spikes of a presentation, and mean theta, of the released network."""


def traverse(condition: str) -> list[NDArray[np.uint8]]:
    """The 100 places of the synthetic world."""
    return [render(World(), place, condition) for place in range(100)]


def test_released_spikes_of_a_presentation(data_root: Path) -> None:
    path = data_root / "oracle" / "vprsnn_train_counts.npz"
    if not path.is_file():
        pytest.skip(f"needs the released spike counts {path.name}")
    with np.load(path) as released:
        assert released["counts"].sum(axis=1).mean() == pytest.approx(SPIKES, abs=0.005)


@pytest.mark.slow
@pytest.mark.timeout(1200)
def test_training_equals_the_release_in_its_figures() -> None:
    """On two traverses made up here; and the network is behind SAD on them, as it is on real seasons."""
    model = train(traverse("summer"), traverse("rain"), config=preset("paper"))
    network = model.network
    assert isinstance(network, ConductanceState)
    assert (model.training["neurons_used"], model.training["places_covered"]) == (400, 100)
    assert model.training["spikes_per_image"] == pytest.approx(17.76, abs=0.05)
    assert model.training["spikes_per_image"] == pytest.approx(SPIKES, rel=0.05)
    assert network.theta_mv.mean() == pytest.approx(40.04, abs=0.05)
    assert network.theta_mv.mean() == pytest.approx(THETA_MV, rel=0.01)
    for condition, sad, weighted in (("winter", 0.67, 0.35), ("night", 0.62, 0.17)):
        (queries,) = encode_arrays(traverse(condition), model.config.encoder, keep=Keep.ALL)
        comparison = Comparison(rivals=("sad",), keep_scores=False)
        found = recognise(model, queries, np.eye(100, dtype=np.bool_), comparison).metrics
        assert found["sad"].recall_at_1 == pytest.approx(sad, abs=0.015)
        assert found["weighted_probability"].recall_at_1 == pytest.approx(weighted, abs=0.05)
