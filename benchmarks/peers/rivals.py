"""Other systems that answer the same queries as lava-vpr: VPRTempo, and VPRSNN's network in Brian2.

VPRTempo takes turns with the matchers of `lava_vpr.bench.measure.matchers`. VPRSNN's network runs in Brian2, in an
environment that has it (`make peers`); a few queries, one thread.
"""

from __future__ import annotations

import importlib.util
import json
import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.peers import vprtempo
from lava_vpr.bench.measure.matchers import TimedMatcher, repeats
from lava_vpr.bench.results import Peer
from lava_vpr.config import ConductanceNetwork, Config, preset
from lava_vpr.configfile import to_dict
from lava_vpr.encoding import EncodedTraverse
from lava_vpr.engine.conductance.model import ConductanceState, initial_state
from lava_vpr.errors import BackendUnavailableError
from lava_vpr.inputs.encoder import Keep
from lava_vpr.isolated.child import run_child
from lava_vpr.matching.evaluation import evaluate
from lava_vpr.model import Model
from lava_vpr.storage.writing import temporary_folder
from lava_vpr.traverse import Traverse

PYTHON = "LAVA_VPR_PEERS"
"""Environment variable that names a Python with Brian2 and lava-vpr."""
REMEDY = f"run make peers, or let {PYTHON} name a Python that has both Brian2 and lava-vpr"
TIMEOUT = 600.0
MODULE = 500
"""Places of one of VPRTempo's modules, which are trained apart (default of the released code)."""
OwnImages = tuple[NDArray[np.uint8], NDArray[np.uint8]]
"""References and queries as VPRTempo preprocesses them."""
NETWORK = Path(__file__).with_name("brian2_network.py")


def train_modules(images: NDArray[np.uint8], labels: NDArray[np.int64], seed: int = 0) -> tuple[vprtempo.VprTempo, ...]:
    """VPRTempo on reference ``images`` (n, side, side) of the places ``labels``, in modules of `MODULE` places."""
    spikes = vprtempo.input_spikes(images)
    modules = []
    for first in range(0, int(labels.max()) + 1, MODULE):
        inside = (labels >= first) & (labels < first + MODULE)
        modules.append(vprtempo.train(spikes[inside], labels[inside] - first, seed=seed))
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
        model, queries, truth: As in `benchmarks.peers.side_by_side.all_peers`.
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


def interpreter() -> str | None:
    """A Python with Brian2: named by `PYTHON`, this one, or the checkout's ``.venv-peers``; None: there is none."""
    named = os.environ.get(PYTHON)
    if named:
        return named
    if importlib.util.find_spec("brian2") is not None:
        return sys.executable
    made = Path(__file__).parents[2] / ".venv-peers" / "bin" / "python"
    return str(made) if made.exists() else None


def _reference(model: Model) -> tuple[Config, ConductanceState, str]:
    """VPRSNN's network: the model's own if it is one, else untrained; and what to say of it."""
    if isinstance(model.network, ConductanceState) and isinstance(model.config.network, ConductanceNetwork):
        return model.config, model.network, "this model's own network, frozen"
    config = preset("paper")
    return config, initial_state(config, model.patches[0].size), "untrained and frozen: speed only, recall not computed"


def in_brian2(
    config: Config, state: ConductanceState, rate_hz: NDArray[np.float64], python: str, timeout: float = TIMEOUT
) -> dict[str, Any]:
    """Present ``rate_hz`` (n, inputs) to the frozen network in another Python: version, seconds and spikes of each.

    Raises:
        BackendUnavailableError: it cannot be started, lacks Brian2 or lava-vpr, fails, or takes too long.
    """
    with temporary_folder() as folder:
        np.savez(
            folder / "given.npz", weights=state.weights, theta_mv=state.theta_mv, delays=state.delays, rate_hz=rate_hz
        )
        (folder / "config.json").write_text(json.dumps(to_dict(config)), encoding="utf-8")
        command = [python, str(NETWORK), str(folder)]
        try:
            ended = run_child(command, seconds=timeout, folder=folder)
        except OSError as error:
            raise BackendUnavailableError(f"{python}: cannot be started ({error.strerror}); {REMEDY}") from None
        except subprocess.TimeoutExpired:
            raise BackendUnavailableError(
                f"{python}: Brian2 took more than {timeout:.0f} s; give fewer queries"
            ) from None
        if ended.code or not (folder / "found.json").is_file():
            raise BackendUnavailableError(f"{python}: Brian2 did not run ({ended.last or 'it says nothing'}); {REMEDY}")
        answer: dict[str, Any] = json.loads((folder / "found.json").read_text(encoding="utf-8"))
    return answer


def brian2_peer(model: Model, queries: EncodedTraverse, limit: int, python: str | None = None) -> Peer:
    """VPRSNN's network in Brian2 on the first ``limit`` queries; ``absent`` says why it did not run."""
    blank = Peer("brian2", "VPRSNN's network (Hussaini et al. 2022) in Brian2, one thread")
    chosen = python or interpreter()
    if chosen is None:
        return replace(blank, absent=f"Brian2 is not installed; {REMEDY}")
    config, state, which = _reference(model)
    network = config.network
    silent = f" and {network.rest_steps} of rest" if isinstance(network, ConductanceNetwork) else ""
    patches = queries.kept(Keep.PATCHES, "Brian2")[:limit].reshape(min(limit, len(queries)), -1)
    try:
        answer = in_brian2(config, state, patches * (config.encoder.max_rate_hz / 255.0), chosen)
    except BackendUnavailableError as error:
        return replace(blank, absent=str(error))
    seconds = answer["seconds"]
    return replace(
        blank,
        what=f"{blank.what}, version {answer['version']}; {len(state.theta_mv)} neurons, {which}; "
        f"a query has {network.steps} steps with input{silent}",
        queries_per_second=1.0 / float(np.median(seconds)),
        bytes=state.weights.nbytes + state.theta_mv.nbytes + state.delays.nbytes,
        queries=len(seconds),
    )
