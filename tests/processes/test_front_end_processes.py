"""The spiking front end as Lava Processes: every spike of every population is the host's."""

from __future__ import annotations

from dataclasses import replace
from typing import Any
from unittest import mock

import numpy as np
import pytest
from lava.proc.sparse.models import PySparseModelBitAcc
from lava.proc.sparse.process import Sparse
from lava.utils.weightutils import SignMode
from numpy.typing import NDArray
from scipy.sparse import csr_matrix
from support.lava.model_harness import build, drive

from lava_vpr.engine.inference.fixed import FixedNetwork
from lava_vpr.engine.inference.whole import WholeNetwork, settings_of
from lava_vpr.errors import NetworkLimitError
from lava_vpr.inputs.front_end import FrontEnd
from lava_vpr.inputs.front_end_settings import FRONT_END
from lava_vpr.isolated.runner import run_isolated
from lava_vpr.loihi import INPUT_SHIFT
from lava_vpr.processes.front_end.process import FrontEndNetwork
from lava_vpr.processes.sparse_synapses.process import (
    PySparseSynapsesFixed,
    PySparseSynapsesFloat,
    SparseSynapses,
)
from lava_vpr.synthetic.world import World, render

pytestmark = pytest.mark.lava
TINY = FrontEnd(8, budget=12)
TINY_EVENTS = FrontEnd(8, budget=12, levels=12, window=6, white=18)


def grey(spec: FrontEnd, images: int) -> NDArray[np.uint8]:
    """What is shown of places of the built-in world, or of an edge with events, uint8 (images, *shape)."""
    if spec.window:
        rates = np.linspace(0.1, spec.window, spec.shape[1])
        return np.array([spec.seen(np.random.default_rng(k).poisson(rates, spec.shape)) for k in range(images)])
    return np.array([spec.seen(render(World(0), place, "summer")) for place in range(images)])


def in_lava(
    job: str,
    spec: FrontEnd,
    shown: NDArray[np.uint8],
    tag: str = "fixed_pt",
    bias: NDArray[np.int32] | None = None,
) -> dict[str, NDArray[np.uint8]]:
    """Every spike of each population."""
    target, arrays = f"lava_vpr.processes.jobs.front_end:{job}", {"grey": shown}
    options: dict[str, Any] = {"spec": settings_of(spec), "tag": tag}
    if isinstance(spec, WholeNetwork):
        arrays |= {"weights": spec.places.weights, "bias": spec.places.bias}
        options["network"] = spec.places.scalars
    if bias is not None:
        arrays["biases"] = bias
    return run_isolated(target, arrays, options, timeout=500)


def differing(
    job: str, spec: FrontEnd, images: int, tag: str = "fixed_pt", bias: NDArray[np.int32] | None = None
) -> dict[str, int]:
    """How many spikes of each population differ from the host's, of which every population has some."""
    shown = grey(spec, images)
    own, found = spec.trains(shown, bias), in_lava(job, spec, shown, tag, bias)
    assert all(film.any(axis=(1, 2)).all() for film in own.values())
    return {name: int((film != found[name]).sum()) for name, film in own.items()}


@pytest.mark.parametrize(
    ("job", "images"), [("composed", 2), *(pytest.param(*case, marks=pytest.mark.slow) for case in (("library", 3),))]
)
def test_a_small_front_end_spikes_as_on_the_host(job: str, images: int) -> None:
    assert set(differing(job, TINY, images).values()) == {0}


def whole() -> WholeNetwork:
    """The small front end, and eight neurons that hear its cells: each those of one channel, less what all hear."""
    spec = replace(TINY, levels=12, race=8, reading=4)
    channel = np.arange(spec.populations["cells"])[:, None] // spec.grid**2
    weights = np.where(channel == np.arange(8), 7, -1).astype(np.int16)
    bias = -np.arange(8, dtype=np.int32) << INPUT_SHIFT
    numbers = {"bits": 3, "signed": True, "threshold": 20, "inhibition": 9, "inhibition_exponent": 4, "decay": 300}
    steps = {"steps": spec.ticks, "regular": True, "rising": spec.rising, "rise": 2}
    return WholeNetwork.of(spec, FixedNetwork(weights, bias, **numbers, **steps))  # type: ignore[arg-type]


@pytest.mark.parametrize("job", ["composed", pytest.param("library", marks=pytest.mark.slow)])
def test_neurons_that_hear_its_cells_spike_as_on_the_host(job: str) -> None:
    assert differing(job, whole(), 2) == dict.fromkeys(whole().populations, 0)


@pytest.mark.parametrize("job", ["composed", pytest.param("library", marks=pytest.mark.slow)])
def test_biases_of_each_presentation_count(job: str) -> None:
    bias = -40 * np.arange(16, dtype=np.int32).reshape(2, 8)
    bias[0, 0] = -(1 << 13)  # whose register needs an exponent
    assert not np.array_equal(whole().trains(grey(whole(), 2), bias)["exc"], whole().trains(grey(whole(), 2))["exc"])
    assert differing(job, whole(), 2, bias=bias) == dict.fromkeys(whole().populations, 0)


@pytest.mark.slow
@pytest.mark.parametrize("job", ["composed", "library"])
def test_events_drive_it_as_on_the_host(job: str) -> None:
    assert set(differing(job, TINY_EVENTS, 3).values()) == {0}


@pytest.mark.slow
@pytest.mark.parametrize("job", ["composed", "library"])
def test_the_front_end_spikes_as_on_the_host(job: str) -> None:
    assert set(differing(job, FRONT_END, 2).values()) == {0}


@pytest.mark.slow
@pytest.mark.parametrize("job", ["composed", "library"])
def test_in_floating_point_few_spikes_differ(job: str) -> None:
    found = differing(job, TINY, 2, "floating_pt")
    assert found["clock"] == found["pixels"] == 0
    assert sum(found.values()) <= 10


@pytest.mark.parametrize("sign", [1, -1])
@pytest.mark.parametrize(("exponent", "bits", "messages"), [(0, 8, 0), (7, 8, 0), (-4, 4, 12), (2, 6, 3)])
def test_sparse_synapses_are_lavas(sign: int, exponent: int, bits: int, messages: int) -> None:
    rng = np.random.default_rng(exponent + 7)
    weights = csr_matrix(sign * rng.integers(0, 256, (9, 6)) * (rng.random((9, 6)) < 0.3))
    sent = (rng.random((12, 6)) < 0.3) * rng.integers(1, max(2, 1 << messages), (12, 6))
    format_ = {"weight_exp": exponent, "num_weight_bits": bits, "num_message_bits": messages}
    mode = SignMode.EXCITATORY if sign > 0 else SignMode.INHIBITORY
    with mock.patch.object(PySparseModelBitAcc.s_in, "d_type", np.int32):  # Lava's ports take what is sent
        lava = build(Sparse(weights=weights, sign_mode=mode, **format_), PySparseModelBitAcc)
    expected = drive(lava, sent, "s_in", "a_out")
    assert expected.any()
    for kind in (PySparseSynapsesFixed, PySparseSynapsesFloat):
        ours = build(SparseSynapses(weights=weights, **format_), kind)
        same = drive(ours, sent, "s_in", "a_out")
        if kind is PySparseSynapsesFixed or bits == 8:  # the float model stores all bits
            assert np.array_equal(same, expected)


@pytest.mark.parametrize(
    ("weights", "exponent", "words"),
    [
        (csr_matrix([[256]]), 0, "SparseSynapses: excitatory weight is 256, but must be a whole number in 0..255"),
        (csr_matrix([[-256]]), 0, "SparseSynapses: inhibitory weight is -256, but must be a whole number in -255..0"),
        (csr_matrix([[1, -1]]), 0, "SparseSynapses: signs is of both kinds, but must be one: make two Processes"),
        (csr_matrix([[np.inf]]), 0, "SparseSynapses: a weight is inf, but must be finite"),
        (csr_matrix([[1]]), -8, "weight_exp is -8, but must be in -7..7"),
        (np.eye(2, dtype=int), 0, "SparseSynapses: weights must be a sparse matrix of numbers"),
    ],
)
def test_synapses_that_cannot_be_are_refused(weights: csr_matrix, exponent: int, words: str) -> None:
    with pytest.raises(NetworkLimitError) as caught:
        SparseSynapses(weights=weights, weight_exp=exponent)
    assert words in str(caught.value)


def test_fractions_are_for_the_float_model_only() -> None:
    synapses = SparseSynapses(weights=csr_matrix([[0.5]]))
    synapses._model_class = PySparseSynapsesFloat  # what Lava's compiler does when it has picked a model
    with pytest.raises(NetworkLimitError, match=r"weight is 0\.5"):
        synapses._model_class = PySparseSynapsesFixed


def test_images_of_another_shape_are_refused() -> None:
    with pytest.raises(NetworkLimitError, match=r"images is uint8 \(1, 8, 8\), but must be uint8 \(n, 4, 8\)"):
        FrontEndNetwork(spec=TINY, grey=np.zeros((1, 8, 8), np.uint8))
