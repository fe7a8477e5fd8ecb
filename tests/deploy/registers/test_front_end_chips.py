"""The registers of a spiking front end: every spike is the general simulator's, and what cannot be is refused."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from support.literal import front_end as literal

from lava_vpr.deploy.boards.board import KAPOHO_BAY
from lava_vpr.deploy.mapping.front_end_images import FrontEndImages, front_end_images
from lava_vpr.deploy.registers.front_end import FrontEndChips
from lava_vpr.engine.presentations import PixelBlock
from lava_vpr.errors import ModelFileError
from lava_vpr.inputs.front_end import FrontEnd

SPEC = FrontEnd(width=8, levels=8, race=6, budget=20)


def shown(spec: FrontEnd) -> NDArray[np.uint8]:
    """Three images, of noise, of two grey levels and of one, uint8 (3, height, width)."""
    grey = np.random.default_rng(3).integers(0, 256, (3, spec.height, spec.width))
    grey[1] = np.where(grey[1] > 128, 255, 0)
    grey[2] = 90
    return grey.astype(np.uint8)


def chips(made: FrontEndImages, steps: int = SPEC.steps) -> FrontEndChips:
    return FrontEndChips.of(made.cores, made.tables, steps)


@pytest.mark.parametrize(("compartments", "taken"), [(1024, ()), (48, ((0, 0), (0, 2)))])
def test_every_spike_of_every_population_is_the_general_simulators(
    compartments: int, taken: tuple[tuple[int, int], ...]
) -> None:
    made = front_end_images(SPEC, replace(KAPOHO_BAY, compartments=compartments), taken)
    assert not {(core.chip, core.core) for core in made.cores} & set(taken)
    grey = shown(SPEC)
    films, expected = chips(made).present(PixelBlock(grey)), literal.trains(SPEC, grey)
    assert list(films) == list(expected)
    for name, film in expected.items():
        assert film[:2].any(), name
        assert np.array_equal(films[name], film), name


def test_spikes_that_are_on_their_way_at_the_end_are_refused() -> None:
    with pytest.raises(ModelFileError, match=r"^presentation 0: \d+ spikes are still on their way after its last step"):
        chips(front_end_images(SPEC, KAPOHO_BAY, ()), SPEC.levels).present(PixelBlock(shown(SPEC)))
