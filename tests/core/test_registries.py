"""A decoder and a kind of input are added by a row each, and every command, file and report knows them."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray
from support.common.commands import fails, run

from lava_vpr import model as model_file
from lava_vpr.config import Config, DecoderConfig
from lava_vpr.encoding import encode_traverse
from lava_vpr.errors import ConfigError, ModelFileError
from lava_vpr.inputs.encoder import INPUTS, ChannelLayout, EncoderConfig, Input
from lava_vpr.matching import certainty
from lava_vpr.matching.decoders import DECODERS, Decoder, Reading, in_every_variant
from lava_vpr.matching.equations import ScoresOf
from lava_vpr.recognition import count_query_spikes
from lava_vpr.synthetic.world import write_traverses
from lava_vpr.traverse import open_traverse

PLACES = 5
SETTINGS = "[network]\nsteps = 128\n[learning]\nsteps = 120\nepochs = 4\n[decoder]\ndefault = 'dummy'\n"


def overlap(responses: NDArray[Any], reading: Reading) -> ScoresOf:
    """The number of pairs of a query's spike and a reference's spike of the same neuron."""
    return lambda spikes: (spikes.astype(np.int64) @ responses.astype(np.int64)).astype(np.float64)


DUMMY_DECODER = Decoder(
    "dummy", title="overlap of spikes", confidence=certainty.margin, scores=in_every_variant(overlap)
)
DUMMY_INPUT = Input(
    "dummy",
    layout=lambda encoder: ChannelLayout(1, 14),
    sees="patch",
    activity=lambda patch, encoder: cv2.resize(patch, (14, 14)).reshape(-1).astype(np.float32),
    grey_levels=True,
    drawing="grey",
    legend="A quarter of the pixels.",
)


@pytest.fixture
def registered() -> Iterator[None]:
    DECODERS.register(DUMMY_DECODER)
    INPUTS.register(DUMMY_INPUT)
    yield
    DECODERS.remove("dummy")
    INPUTS.remove("dummy")


@pytest.mark.usefixtures("registered")
def test_rows_are_all_that_the_commands_need(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    write_traverses(tmp_path, PLACES, 0)
    Path("settings.toml").write_text(SETTINGS)
    assert "dummy" in run("train", "--help").stdout
    run("train", "reference", "-o", "m.lvpr", "--config", "settings.toml", "--input", "dummy")
    table = run("eval", "m.lvpr", "query", "--json", "f.json", "--report", "r").stdout
    assert "dummy *" in table
    figures = json.loads(Path("f.json").read_text())
    assert figures["default_decoder"] == "dummy"
    assert list(figures["decoders"]) == [*(name for name in DECODERS if name != "dummy"), "dummy"]
    page = Path("r/report.html").read_text(encoding="utf-8")
    for text in ("overlap of spikes", "A quarter of the pixels.", "196 (dummy)", 'alt="Weights of neuron'):
        assert text in page
    run("query", "m.lvpr", "query", "-o", "matches.csv")

    model = model_file.load(Path("m.lvpr"))
    queries = encode_traverse(open_traverse("query"), model.config.encoder)
    assert queries.activity.shape == (PLACES, 196)
    counts, _ = count_query_spikes(model, queries)
    scores = overlap(model.responses, Reading())(counts)
    assert scores.any()
    ranks = (scores > scores[np.arange(PLACES), np.arange(PLACES)][:, None]).sum(axis=1)
    assert figures["decoders"]["dummy"]["recall_at_n"]["5"] == np.mean(ranks < 5)

    INPUTS.remove("dummy")  # the file outlives the row
    with pytest.raises(ModelFileError, match=r"encoder\.kind is 'dummy', but must be one of orientation, filters"):
        model_file.load(Path("m.lvpr"))
    INPUTS.register(DUMMY_INPUT)


def test_removed_rows_are_unknown_again() -> None:
    with pytest.raises(ConfigError, match=r"decoder\.default is 'dummy', but must be one of contrast"):
        Config(decoder=DecoderConfig(default="dummy"))
    with pytest.raises(ConfigError, match=r"encoder\.kind is 'dummy', but must be one of orientation"):
        EncoderConfig(kind="dummy")
    refusal = f"'dummy' is not one of {', '.join(map(repr, INPUTS))}"
    assert refusal in fails("train", "reference", "-o", "m.lvpr", "--input", "dummy", code=2)


@pytest.mark.parametrize(
    ("part", "message"),
    [
        ({"scores": {}}, "no score function for the variant vprsnn2022, vprsnn, printed"),
        ({"scores": {"vprsnn2022": overlap}}, "no score function for the variant vprsnn, printed"),
    ],
)
def test_a_decoder_without_a_variant_is_refused(part: dict[str, Any], message: str) -> None:
    with pytest.raises(TypeError, match=message):
        DECODERS.register(replace(DUMMY_DECODER, **part))
    assert "dummy" not in DECODERS
