"""The host programs as they stand in a bundle, in one folder, and loaded from there into this process; small bundles.

Used by bench, deploy and support.
"""

from __future__ import annotations

import ast
import compileall
import importlib
import json
import sys
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lava_vpr.deploy.bundle import folder as bundle, targets
from lava_vpr.deploy.bundle.folder import array_bytes
from lava_vpr.engine.inference.biases import bias_registers
from lava_vpr.engine.inference.counting import count_spikes
from lava_vpr.engine.inference.fixed import FixedNetwork


@dataclass(frozen=True)
class Made:
    """A bundle, the network in it, and presentations with the counts that the host gives them."""

    path: Path
    network: FixedNetwork
    rates: NDArray[np.uint16]
    keys: NDArray[np.uint64]
    counts: NDArray[np.int32]


def files(board: str) -> dict[str, bytes]:
    """What ``program/`` of a bundle holds, by name."""
    return {Path(name).name: data for name, data in targets.program_files(board).items()}


def flat(board: str, folder: Path) -> Path:
    """They in a folder, compiled once, for a program that is loaded writes no compiled modules."""
    folder.mkdir()
    for name, content in files(board).items():
        (folder / name).write_bytes(content)
    compileall.compile_dir(folder, quiet=1)
    return folder


def load(folder: Path) -> Any:
    """The modules in ``folder`` by name, as attributes. This process then knows none of them: another folder's can be
    loaded as well."""
    names = sorted(path.stem for path in folder.glob("*.py"))
    before, written = {name: sys.modules.pop(name, None) for name in names}, sys.dont_write_bytecode
    sys.path.insert(0, str(folder))
    try:
        importlib.invalidate_caches()
        return SimpleNamespace(**{name: importlib.import_module(name) for name in names})
    finally:
        sys.path.remove(str(folder))
        sys.dont_write_bytecode = written
        for name, module in before.items():
            sys.modules.pop(name, None)
            if module is not None:
                sys.modules[name] = module


def imported(board: str, version: tuple[int, int]) -> set[str]:
    """Names of the packages that a program imports, beside its own modules; it has the syntax of a Python version."""
    content = files(board)
    names = set()
    for name, text in content.items():
        if not name.endswith(".py"):
            continue
        for node in ast.walk(ast.parse(text.decode(), name, feature_version=version)):
            if isinstance(node, ast.Import):
                names |= {alias.name.split(".")[0] for alias in node.names}
            elif isinstance(node, ast.ImportFrom):
                names.add(str(node.module).split(".")[0])
    return names - {name.removesuffix(".py") for name in content}


def write_bundle(
    path: Path, board: str, network: FixedNetwork, files_: Mapping[str, bytes], shown: Any, labels: Any, **told: Any
) -> Made:
    """A bundle whose network is in ``files_``, with its program and references: ``shown`` rates and keys of ``labels``.

    ``told`` is more of its manifest.
    """
    rates, keys = shown
    counts, _, _ = count_spikes(network, rates, keys)
    responses = np.zeros((network.neurons, int(labels.max()) + 1), np.int32)
    np.add.at(responses.T, labels, counts)
    arrays = {"rates": rates, "keys": keys, "labels": labels, "responses": responses}
    content = {f"host/{name}.npy": array_bytes(array) for name, array in arrays.items()}
    program = {f"program/{name}": data for name, data in files(board.replace("-", "_")).items()}
    sizes = {"inputs": network.inputs, "neurons": network.neurons, "silent_steps": network.silent_steps}
    manifest = {"target": board, "network": {**sizes, **network.scalars}, **told}
    bundle.write(path, manifest, {**files_, **content, **program})
    return Made(path, network, rates, keys, counts)


def write_queries(
    folder: Path, rates: NDArray[np.uint16], keys: NDArray[np.uint64], biases: NDArray[np.int32] | None = None
) -> Path:
    """A folder as ``--queries`` takes it, maybe with the biases of each query."""
    folder.mkdir(exist_ok=True)
    registers = {} if biases is None else dict(zip(("biases", "exponents"), bias_registers(biases), strict=True))
    for name, array in {"rates": rates, "keys": keys, **registers}.items():
        np.save(folder / f"{name}.npy", array)
    return folder


def answers(folder: Path) -> tuple[NDArray[np.int32], NDArray[np.bool_], dict[str, Any]]:
    """What a program left: counts, which rows are answered, status."""
    status = json.loads((folder / "status.json").read_text())
    return np.load(folder / "counts.npy"), np.load(folder / "done.npy"), status


def pixel_queries(folder: Path, shown: NDArray[np.generic], bias: NDArray[np.int32] | None = None) -> Path:
    """A new folder of pictures to be presented, with biases if each has its own."""
    folder.mkdir()
    np.save(folder / "pixels.npy", shown)
    for name, array in zip(("biases", "exponents"), () if bias is None else bias_registers(bias), strict=False):
        np.save(folder / f"{name}.npy", array)
    return folder
