"""The process that runs Lava: it takes a job from a folder and leaves its answers, or the first failure, there."""

from __future__ import annotations

import contextlib
import json
import multiprocessing
import os
import shutil
import signal
import threading
import time
from pathlib import Path
from typing import Any

import numpy as np

from lava_network import Player, define_processes
from refusals import Refused
from result_files import put

LOOK = 0.1  # seconds between two looks at Lava's processes


def record(folder: Path, error: BaseException, where: str = "") -> None:
    """Note the first failure, as stage and one line."""
    text = " ".join(str(error).split())[:400]
    line = text if isinstance(error, Refused) else f"{where or 'Lava'}: {type(error).__name__}: {text}"
    with contextlib.suppress(OSError):
        own = folder / f"error-{os.getpid()}-{threading.get_ident()}"
        own.write_text(json.dumps([getattr(error, "stage", "run"), line]), encoding="utf-8")
        os.link(own, folder / "error")


def tell_failures(folder: Path) -> None:
    """Let exceptions of Lava's models and services be noted: Lava keeps them to itself, and their peers wait."""
    from lava.magma.runtime import runtime

    plain = runtime.target_fn

    def target_fn(*args: Any, **kwargs: Any) -> None:
        part = getattr(kwargs.get("builder"), "proc_model", None) or getattr(kwargs.get("builder"), "rs_class", None)
        try:
            plain(*args, **kwargs)
        except BaseException as error:
            record(folder, error, getattr(part, "__name__", "Lava"))
            raise

    runtime.target_fn = target_fn


def watch(folder: Path, caller: int, player: list[Player]) -> None:
    """For ever: end with the caller, note a process of Lava's that dies, tell how far the read-out is."""
    while True:
        if os.getppid() != caller:
            shutil.rmtree(folder, ignore_errors=True)
            os.killpg(0, signal.SIGTERM)
        for child in list(vars(multiprocessing.process)["_children"]):
            code = end_of(child.pid)
            if code and code != -signal.SIGTERM:
                record(folder, Refused("run", f"a process of Lava's ({child.name}) ended with code {code}; run again"))
        if player:
            (folder / "steps").write_text(f"{player[0].seen[0]:,}", encoding="ascii")
        time.sleep(LOOK)


def end_of(pid: int) -> int:
    """Exit code of a child (negative: a signal), which is left to be reaped by who started it; 0 while it runs."""
    try:
        ended = os.waitid(os.P_PID, pid, os.WEXITED | os.WNOHANG | os.WNOWAIT)
    except ChildProcessError:
        return 0
    if ended is None:
        return 0
    return ended.si_status if ended.si_code == os.CLD_EXITED else -ended.si_status


def work(folder: Path) -> int:
    """Present the queries of a job; the exit code."""
    try:
        options = json.loads((folder / "options.json").read_bytes())
        parameters = json.loads((folder / "parameters.json").read_bytes())
        names = ["weights", "bias", "rates", "keys"]
        names += [name for name in ("biases", "exponents") if (folder / f"{name}.npy").exists()]
        arrays = {name: np.load(folder / f"{name}.npy") for name in names}
        queries = len(arrays["rates"])
        players: list[Player] = []
        threading.Thread(target=watch, args=(folder, options["caller"], players), daemon=True).start()
        define_processes()
        tell_failures(folder)
        player = Player(parameters, arrays, options)
        players.append(player)
        for start in range(0, queries, options["batch"]):
            end = min(queries, start + options["batch"])
            put(str(folder / f"batch-{start}.npy"), player.present(start, end))
        player.process.stop()
        if player.profiler:
            put(str(folder / "power.json"), player.profiler.figures())
    except BaseException as error:
        record(folder, error)
        return 1
    return 0
