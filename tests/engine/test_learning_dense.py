"""Our STDP in integers against Lava's own LearningDense: every weight, trace and sum in every step."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from lava_vpr.engine.learning.integer import WeightRule
from lava_vpr.engine.learning.lava_order import LibraryDraws
from lava_vpr.errors import NetworkLimitError
from lava_vpr.isolated.runner import run_isolated

RULES, BLOCKS, SIZE, STEPS = 8, 5, 8, 40


def random_rule(rng: np.random.Generator) -> dict:
    """Any rule that Lava's microcode expresses, of an effect that is neither nothing nor saturation at once."""
    mu = int(rng.integers(0, 3))
    products = []
    for _ in range(rng.integers(1, 4)):
        mantissa = int(rng.choice([m for m in range(-8, 8) if m]))
        exponent = int(rng.integers(-7, 0 if mu == 0 else 4))
        products.append((mantissa, exponent))
    tau = float(rng.choice([1.0, 2.5, 10.0, 20.0, 33.3, 100.0]))
    rule = {"products": products, "target": int(rng.integers(0, 128)), "mu": mu, "tau": tau}
    WeightRule(**{**rule, "products": tuple(products)}).check()
    return rule


def random_start(rng: np.random.Generator) -> tuple[NDArray[np.bool_], NDArray[np.bool_], NDArray[np.uint8], dict]:
    """Spikes, weights and rules of one start; a network is a block of inputs and neurons with rates of its own."""
    rates = np.repeat(rng.uniform(0.02, 0.5, (2, BLOCKS)), SIZE, axis=1)
    pre, post = (rng.random((STEPS, BLOCKS * SIZE)) < rate for rate in rates)
    weights = rng.integers(0, 256, (RULES, BLOCKS * SIZE, BLOCKS * SIZE)).astype(np.uint8)
    weights[rng.random(weights.shape) < 0.05] = 0
    weights[rng.random(weights.shape) < 0.05] = 255
    seeds = rng.integers(0, 1 << 31, RULES).tolist()
    options = {"rules": [random_rule(rng) for _ in range(RULES)], "seeds": seeds}
    return pre, post, weights, {**options, "weight_exp": int(rng.integers(-6, 3))}


def blocks(weights: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """The weights (..., networks, SIZE, SIZE) within each network, of (..., neurons, inputs)."""
    grid = weights.reshape(*weights.shape[:-2], BLOCKS, SIZE, BLOCKS, SIZE)
    return np.moveaxis(np.diagonal(grid, axis1=-4, axis2=-2), -1, -3)


def hold_against_lava(starts: int, seed: int) -> None:
    """``starts`` x RULES x BLOCKS random networks."""
    rng = np.random.default_rng(seed)
    pre, post, weights, options = zip(*(random_start(rng) for _ in range(starts)), strict=True)
    arrays = {"pre": np.stack(pre), "post": np.stack(post), "weights": np.stack(weights)}
    found = run_isolated(
        "support.lava.learning_dense:compare", arrays, {"starts": list(options)}, timeout=30 + 20 * starts
    )
    for name in ("weights", "x1", "a_buff"):
        for start in range(starts):
            for k, rule in enumerate(options[start]["rules"]):
                library, ours = (found[f"{kind}_{name}"][start, k] for kind in ("library", "ours"))
                assert np.array_equal(library, ours), (name, rule)
    before, film = (
        blocks(arrays["weights"]),
        blocks(found["ours_weights"]),
    )  # film: (starts, rules, steps, networks, ..)
    n = starts * RULES * BLOCKS
    last = film[:, :, -1]
    figures = {"changed": (last != before).any((-1, -2)).sum()}
    for bound in (0, 255):
        reached = ((film == bound).any(2) & (before != bound)).any((-1, -2))
        figures[f"saturated at {bound}"] = reached.sum()
    print(f"{n} networks:", ", ".join(f"{count} {name}" for name, count in figures.items()))
    assert min(figures.values()) >= n / 10
    assert (found["ours_x1"].max(2) == 127).any()


@pytest.mark.lava
def test_40_random_networks_equal_lavas_learning_dense() -> None:
    hold_against_lava(1, seed=0)


@pytest.mark.lava
@pytest.mark.slow
def test_more_random_networks_equal_lavas_learning_dense() -> None:
    hold_against_lava(25, seed=1)


@pytest.mark.lava
def test_lavas_streams_are_those_of_its_generators() -> None:
    from lava.magma.core.learning.random import ConnVarRandom, TraceRandom

    traces, weights = LibraryDraws(11).next(5)
    trace_random, weight_random = TraceRandom(11, 12), ConnVarRandom()
    for step in range(5):
        trace_random.advance()
        trace_random.advance()
        weight_random.advance()
        assert trace_random.random_trace_decay == traces[step] * 2.0**-53
        assert weight_random.random_stochastic_round == weights[step] * 2.0**-53


@pytest.mark.lava
def test_microcode_of_a_negative_product_is_one_that_lava_reads() -> None:
    from lava.magma.core.learning.learning_rule import Loihi2FLearningRule

    rule = WeightRule(((5, -6), (-3, -2), (-8, -7)), 13, 1, 20.0)
    read = Loihi2FLearningRule(dw=rule.microcode(), x1_impulse=127, x1_tau=20, t_epoch=1, rng_seed=0).dw.products
    sign = (-1) ** rule.mu  # Lava turns (255 - w) into -(w - 255)
    assert [(sign * p.s_mantissa, p.s_exp) for p in read] == [tuple(row) for row in rule.table().tolist()]


@pytest.mark.parametrize(
    ("rule", "text"),
    [
        (WeightRule(((8, 0),), 10, 0, 20.0), "mantissas -8..7"),
        (WeightRule(((1, 9),), 10, 0, 20.0), "exponents -7..8"),
        (WeightRule(((1, 0),), 128, 0, 20.0), "7-bit trace"),
        (WeightRule(((1, 0),), 10, 3, 20.0), "mu 3"),
        (WeightRule(((1, 0),), 10, 0, 0.5), "decays within"),
    ],
)
def test_what_the_learning_engine_cannot_express_is_refused(rule: WeightRule, text: str) -> None:
    with pytest.raises(NetworkLimitError, match=text):
        rule.check()
