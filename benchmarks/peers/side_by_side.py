"""Other systems beside this one, measured in one run.

    python -m benchmarks peers.side_by_side [--presentations N] [--epochs N]

(`make peers` sets it up.)

First, milliseconds per presentation, one core, one process: Brian2, our `paper` preset, our `loihi` preset. Then
every matcher of `lava_vpr.bench.measure.matchers` and VPRTempo on the same places and queries: speed, recall and
memory, real images where LAVA_VPR_DATA names them (Nordland 0:100), else the synthetic world.

Brian2 and `paper` compute the same network: both also get identical input spikes, and their
outputs are compared. All of them take turns, presentation by presentation, and the table holds medians, because other
programs share the machine. Compilation is not counted, nor what Brian2's garbage collection makes of a process as
large as this one (`benchmarks.peers.brian2_network.spare_collection`). Learning is timed twice: at the start, when a
hundred neurons answer every image, and after ``--epochs`` epochs. `loihi` learns and answers the same images in its own
way: 100 neurons, as many steps as its settings say, one call for each presentation.
"""

from __future__ import annotations

import os
import time
from collections.abc import Callable
from statistics import median
from typing import Any

import click
import numpy as np
from numpy.typing import NDArray

from benchmarks.peers import vprtempo
from benchmarks.peers.brian2_network import Brian2Network, spare_collection
from benchmarks.places import ALL_CORES, images_of
from benchmarks.program import Printed, program
from lava_vpr.bench.measure.matchers import TimedMatcher, repeats, run_peers
from lava_vpr.bench.query_set import QuerySet
from lava_vpr.bench.results import Peer
from lava_vpr.config import Config, integer_config, preset
from lava_vpr.encoding import EncodedTraverse, Keep, activity_of, encode_traverse
from lava_vpr.engine.conductance.model import ConductanceState, count_spikes, initial_state, train_presentation
from lava_vpr.engine.inference import counting, quantise
from lava_vpr.engine.inference.surroundings import Shown
from lava_vpr.engine.learning import stdp
from lava_vpr.engine.random import image_keys, presentation_key, presentation_keys
from lava_vpr.engine.rates import draw_spikes, query_rates16, rates16
from lava_vpr.inputs.patches import patch_normalised
from lava_vpr.matching.evaluation import evaluate, values_of
from lava_vpr.model import Model
from lava_vpr.recognition import Comparison, recognise
from lava_vpr.show.numbers import percent
from lava_vpr.show.table import Table
from lava_vpr.storage.writing import temporary_folder
from lava_vpr.synthetic.world import World, render, write_traverses
from lava_vpr.training.loop import train
from lava_vpr.traverse import Traverse, open_traverse

INPUTS = 784
IMAGES = 20
NEURONS = 100
PLACES = (0, 100)
MODULE = 500
"""Places of one of VPRTempo's modules, which are trained apart (default of the released code)."""
OwnImages = tuple[NDArray[np.uint8], NDArray[np.uint8]]
"""References and queries as VPRTempo preprocesses them."""
Times = dict[str, list[float]]


class Loihi:
    """The `loihi` preset on the same images: a plastic network that has seen them all, and its quantised form."""

    def __init__(self, images: list[NDArray[np.uint8]]) -> None:
        config = integer_config(preset("loihi"), "the peer")
        activity = np.stack([activity_of(image, config.encoder) for image in images])
        self.learning_rates = rates16(activity, config.encoder.learning_spikes)
        self.query_rates = query_rates16(activity, config.encoder)
        self.keys = presentation_keys(config.seed, "query", image_keys(self.query_rates))
        learning, inputs, spikes = config.learning, config.encoder.inputs, config.encoder.learning_spikes
        self.state = stdp.initial_state(inputs, NEURONS, learning, spikes, config.seed, 0)
        self.phase = stdp.phases(learning, inputs, spikes)[0]
        for q in range(len(images)):
            self.train(q)
        weights = quantise.distinctive(self.state.weights, config.network)
        self.network = quantise.quantise(weights, config.network, [Shown(self.query_rates, slice(0, NEURONS))])

    def train(self, q: int) -> None:
        """Shows an image to the network that learns."""
        stdp.present(self.state, self.phase, self.learning_rates[q], presentation_key(0, "train", q))

    def test(self, q: int) -> None:
        """Shows an image to the quantised network."""
        counting.count_spikes(self.network, self.query_rates[q : q + 1], self.keys[q : q + 1])


def rates_per_step(images: NDArray[np.uint8], config: Config) -> NDArray[np.uint32]:
    """The paper's rates, value / 4 Hz, as probabilities per step in units of 2^-32."""
    per_step = images * (config.encoder.max_rate_hz / 255.0) * config.network.dt_ms * 1e-3  # type: ignore[union-attr]
    return np.round(per_step * 2.0**32).astype(np.uint32)


def copy_of(state: ConductanceState) -> ConductanceState:
    """A copy of ``state`` that can change by itself."""
    return ConductanceState(state.weights.copy(), state.theta_mv.copy(), state.delays.copy())


def timed(times: Times, name: str, call: Callable[[], object]) -> None:
    """Append the milliseconds that ``call`` takes."""
    start = time.perf_counter()
    call()
    times.setdefault(name, []).append(1e3 * (time.perf_counter() - start))


def measure(
    config: Config, state: ConductanceState, loihi: Loihi, images: NDArray[np.uint8], repeats: int, label: str
) -> Times:
    """Time all three in turns, the conductance model from ``state``: milliseconds by ``train``/``test`` and name."""
    rates, hertz = rates_per_step(images, config), images * (config.encoder.max_rate_hz / 255.0)
    learning = Brian2Network(config, copy_of(state), learn=True)
    frozen = Brian2Network(config, copy_of(state), learn=False)
    ours, fixed = copy_of(state), copy_of(state)
    keys = presentation_keys(config.seed, "query", image_keys(rates))
    times: Times = {}
    for k in range(repeats + 1):
        if k == 1:  # the first round compiles, or loads what was compiled before
            times.clear()
            spare_collection()
        q = k % len(images)
        timed(times, f"{label}/brian2", lambda q=q: learning.present(hertz[q]))  # type: ignore[misc]
        timed(times, f"{label}/paper", lambda q=q, k=k: train_presentation(ours, rates[q], 1000 + k, config))  # type: ignore[misc]
        timed(times, f"{label}/loihi", lambda q=q: loihi.train(q))  # type: ignore[misc]
        timed(times, "test/brian2", lambda q=q: frozen.present(hertz[q]))  # type: ignore[misc]
        timed(times, "test/paper", lambda q=q: count_spikes(fixed, rates[q : q + 1], keys[q : q + 1], config))  # type: ignore[misc]
        timed(times, "test/loihi", lambda q=q: loihi.test(q))  # type: ignore[misc]
    return times


def parity(config: Config, state: ConductanceState, images: NDArray[np.uint8], n: int) -> dict[str, float]:
    """Give both networks the same input spikes: presentations with equal counts, and the largest weight difference."""
    rates, ours = rates_per_step(images, config), copy_of(state)
    theirs = Brian2Network(config, copy_of(state), learn=True, inputs="spikes")
    equal = spikes = 0
    for k in range(n):
        key = presentation_key(config.seed, "train", k)
        counts, _ = train_presentation(ours, rates[k % len(rates)], key, config)
        drawn = draw_spikes(rates[k % len(rates)], key, config.network.steps)
        their_counts, _ = theirs.present_spikes(*np.nonzero(drawn))
        equal += np.array_equal(counts, their_counts)
        spikes += int(counts.sum())
    difference = float(np.abs(ours.weights - theirs.weights).max())
    return {"presentations": n, "equal": equal, "spikes": spikes, "largest_weight_difference": difference}


def train_modules(images: NDArray[np.uint8], labels: NDArray[np.int64]) -> tuple[vprtempo.VprTempo, ...]:
    """VPRTempo on reference ``images`` (n, side, side) of the places ``labels``, in modules of `MODULE` places."""
    spikes = vprtempo.input_spikes(images)
    modules = []
    for first in range(0, int(labels.max()) + 1, MODULE):
        inside = (labels >= first) & (labels < first + MODULE)
        modules.append(vprtempo.train(spikes[inside], labels[inside] - first))
    return tuple(modules)


def vprtempo_matcher(
    name: str,
    what: str,
    references: NDArray[np.uint8],
    labels: NDArray[np.int64],
    queries: NDArray[np.uint8],
    truth: NDArray[np.bool_],
) -> TimedMatcher:
    """VPRTempo, trained now on the references; the best amplitude is the confidence.

    Args:
        name, what: As in `lava_vpr.bench.results.Peer`; ``what`` says which images it sees.
        references, queries: Images uint8 (n, side, side), preprocessed alike.
        labels: Place of each reference, int64 (n,).
        truth: bool (n_queries, places).
    """
    modules = train_modules(references, labels)
    shown = np.tile(queries, (repeats(queries), 1, 1))

    def scores_of(images: NDArray[np.uint8]) -> NDArray[np.float32]:
        spikes = vprtempo.input_spikes(images)
        return np.concatenate([module.scores(spikes) for module in modules], axis=1)

    scores = scores_of(queries).astype(np.float64)
    return TimedMatcher(
        name,
        f"VPRTempo (Hines et al. 2024) from its equations, its settings, trained here on {what}; float32 matrix "
        "products",
        sum(module.nbytes for module in modules),
        lambda part: scores_of(shown[part]).argmax(axis=1),
        evaluate(scores, scores.max(axis=1), truth),
    )


def vprtempo_matchers(
    model: Model, queries: EncodedTraverse, truth: NDArray[np.bool_], own: OwnImages | None = None
) -> list[TimedMatcher]:
    """VPRTempo on its own images, if they are given, and on the smaller ones that a model keeps.

    Args:
        model, queries, truth: As in `all_peers`.
        own: References and queries as VPRTempo preprocesses them (`own_images`).
    """
    found = []
    if own is not None:
        seen = "its own 56x56 images, gamma-corrected and patch-normalised"
        found.append(vprtempo_matcher("vprtempo_own", seen, own[0], model.labels, own[1], truth))
    seen = "the model's 28x28 patch-normalised images, which VPRSNN and SAD see"
    patches = queries.kept(Keep.PATCHES, "VPRTempo")
    return [*found, vprtempo_matcher("vprtempo", seen, model.patches, model.labels, patches, truth)]


def own_images(references: Traverse, queries: Traverse) -> OwnImages:
    """The images of two traverses as VPRTempo preprocesses them, each uint8 (n, 56, 56)."""
    side, window = vprtempo.SIDE, vprtempo.WINDOW
    first, second = (
        np.stack([vprtempo.preprocess(image, side, window) for image in traverse.images()])
        for traverse in (references, queries)
    )
    return first, second


def section() -> tuple[str, EncodedTraverse, EncodedTraverse, OwnImages]:
    """What images they are, references and queries of `PLACES`, and both as VPRTempo preprocesses them."""
    encoder = preset("loihi").encoder
    if os.environ.get("LAVA_VPR_DATA"):
        images = [open_traverse(images_of("nordland", name), places=PLACES) for name in ("summer", "winter")]
        pair = [encode_traverse(traverse, encoder, Keep.ALL) for traverse in images]
        return f"Nordland, summer to winter, places {PLACES[0]}:{PLACES[1]}", pair[0], pair[1], own_images(*images)
    with temporary_folder() as folder:
        root = folder / "world"
        write_traverses(root, PLACES[1] - PLACES[0], 0)
        images = [open_traverse(root / kind) for kind in ("reference", "query")]
        pair = [encode_traverse(traverse, encoder, Keep.ALL) for traverse in images]
        own = own_images(*images)
    return "the synthetic world (set LAVA_VPR_DATA for real images)", pair[0], pair[1], own


def all_peers(
    model: Model,
    queries: EncodedTraverse,
    truth: NDArray[np.bool_],
    own: OwnImages | None = None,
    **options: Any,
) -> tuple[Peer, ...]:
    """lava-vpr, its baselines and VPRTempo in turns.

    Args:
        model: A trained model.
        queries: Encoded with its settings, and all that baselines compare.
        truth: bool (n_queries, places).
        options: As in `lava_vpr.bench.measure.matchers.run_peers`.
        own: The images as VPRTempo preprocesses them; None: it is run on the model's alone.
    """
    others = vprtempo_matchers(model, queries, truth, own)
    known = recognise(model, queries, truth, Comparison(keep_scores=False), pool=ALL_CORES)
    return run_peers(QuerySet.of(model, queries), known, others=others, **options)


def side_by_side() -> tuple[str, tuple[Peer, ...]]:
    """Every matcher on the same places and queries, and what images those were."""
    name, references, queries, own = section()
    config = preset("loihi")
    model = train([references], config, pool=ALL_CORES)
    return name, all_peers(model, queries, np.eye(len(queries), dtype=bool), own)


def peer_table(name: str, peers: tuple[Peer, ...]) -> Table:
    """All peers; ratios are of speed, to this project's."""
    rows, our_rate = [], peers[0].queries_per_second
    for peer in peers:
        rate = peer.queries_per_second
        keys = ("recall_at_1", "recall_at_5", "recall_at_10", "recall_at_100_precision", "auc")
        recall = [percent(value) for value in values_of(peer.metrics, keys)]
        speed = f"{rate:,.0f}" if rate >= 10 else f"{rate:.2g}"
        rows.append(
            [peer.name, speed, f"{rate / our_rate:.2g}", f"{peer.threads}", *recall, f"{peer.bytes / 1000:,.0f}"]
        )
    heads = ("queries/s", "of lava-vpr", "threads", "R@1", "R@5", "R@10", "R@100P", "AUC", "kB kept")
    notes = [f"{peer.name}: {peer.what}" for peer in peers]
    return Table(("matcher", *heads), rows, notes, f"{name}; exact matches, percent")


def presented(presentations: int, epochs: int) -> Table:
    """Milliseconds of presentations, and the comparison of spikes."""
    config = preset("paper")
    pictures = [render(World(), place, "summer") for place in range(IMAGES)]
    patches = np.stack([patch_normalised(picture).ravel() for picture in pictures])
    state, loihi = initial_state(config, INPUTS), Loihi(pictures)
    times = measure(config, state, loihi, patches, presentations, "train, first epoch")
    same = parity(config, state, patches, 3)
    rates = rates_per_step(patches, config)
    for epoch in range(epochs):
        for q, image in enumerate(rates):
            train_presentation(state, image, presentation_key(config.seed, "train", q, epoch), config)
    times |= measure(config, state, loihi, patches, presentations, f"train, epoch {epochs + 1}")
    return presentation_table({name: median(values) for name, values in times.items()}, same)


def presentation_table(figures: dict[str, float], same: dict[str, float]) -> Table:
    """Milliseconds of presentations by what is done and who does it, and whether the spikes were the same."""
    rows = []
    for row in dict.fromkeys(name.split("/")[0] for name in figures):
        brian, paper, ours = (figures[f"{row}/{name}"] for name in ("brian2", "paper", "loihi"))
        rows.append([row, f"{brian:.1f}", f"{paper:.1f}", f"{brian / paper:.0f}", f"{ours:.3f}", f"{brian / ours:.0f}"])
    note = (
        f"same input spikes: {same['equal']} of {same['presentations']} presentations give the same "
        f"{same['spikes']} spikes; largest weight difference {same['largest_weight_difference']:.1e}"
    )
    return Table(("ms per presentation", "Brian2", "paper", "ratio", "loihi", "ratio"), rows, (note,))


@program()
@click.option("--presentations", default=7, show_default=True, help="Timed presentations of each kind.")
@click.option("--epochs", default=25, show_default=True, help=f"Epochs over {IMAGES} images before 'trained'.")
def main(presentations: int, epochs: int) -> Printed:
    """Time VPRSNN's network in Brian2 beside this project's engines, and every peer beside lava-vpr."""
    yield presented(presentations, epochs)
    yield peer_table(*side_by_side())
