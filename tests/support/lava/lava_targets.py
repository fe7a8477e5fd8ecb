"""What tests/isolated/test_runner.py lets a worker call.

Used by isolated.
"""

from __future__ import annotations

import json
import multiprocessing
import os
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lava_vpr.errors import BackendUnavailableError, NetworkLimitError
from lava_vpr.isolated import first_failure
from lava_vpr.isolated.worker import report

Arrays = dict[str, NDArray[Any]]


def echo(arrays: Arrays, options: dict[str, Any]) -> Arrays:
    """What it was given, and where it runs."""
    for done in options.get("reports", ()):
        report(done)
    return {**arrays, "options": np.array(repr(options)), "folder": np.array(str(Path.cwd()))}


def fail(arrays: Arrays, options: dict[str, Any]) -> Arrays:
    """Fails before Lava starts."""
    what = options["what"]
    if what == "limit":
        raise NetworkLimitError("too many\nneurons: take fewer")
    if what == "exit":
        os._exit(0)
    if what == "text":
        return {"text": np.array([object()])}
    if what == "sleep":
        report(1)
        time.sleep(3600)
    return {"none": arrays[what]}


def leave(arrays: Arrays, options: dict[str, Any]) -> Arrays:
    """Starts a program and does not end it; returns when it is told to go on."""
    program = [sys.executable, "-c", "import time; time.sleep(3600)", str(Path.cwd())]
    subprocess.Popen(program, start_new_session=options["session"])
    report(1)
    while not Path("go").exists():
        time.sleep(0.01)
    return {}


def note_slowly(arrays: Arrays, options: dict[str, Any]) -> Arrays:
    """Fails while another process is noting a failure of its own, which it ends, or else is killed over."""
    dumps = json.dumps

    def slow(values: dict[str, Any]) -> str:
        if options["killed"]:
            os.kill(os.getpid(), signal.SIGKILL)
        time.sleep(0.5)
        return dumps(values)

    first_failure.NOTING = options["noting"]
    if os.fork() == 0:
        json.dumps = slow
        first_failure.record_exception(Path.cwd(), NetworkLimitError("the first"))
        os._exit(1)
    while not Path("error.lock").exists():
        time.sleep(0.001)
    raise NetworkLimitError("the second")


def act(arrays: Arrays, options: dict[str, Any]) -> Arrays:
    """Two Processes, of which one does as it is told."""
    from lava.magma.core.run_conditions import RunSteps
    from lava.magma.core.run_configs import Loihi2SimCfg
    from support.lava.lava_models.process import Actor, Listener

    actor, listener = Actor(options["what"], options.get("when", 3)), Listener()
    actor.a_out.connect(listener.a_in)
    actor.run(condition=RunSteps(num_steps=options.get("steps", 5)), run_cfg=Loihi2SimCfg())
    if options.get("stop", True):
        actor.stop()
    return {"done": np.array(True)}


def hardware(arrays: Arrays, options: dict[str, Any]) -> Arrays:
    """What `refuse_cpu_models` says of some networks."""
    from lava.magma.core import run_configs
    from lava.magma.core.run_conditions import RunSteps
    from lava.proc.dense.process import Dense
    from lava.proc.lif.process import LIFReset
    from support.lava.lava_models.process import Actor, Listener

    from lava_vpr.processes.base.lava_checks import refuse_cpu_models

    def library() -> LIFReset:
        first, dense, second = (
            LIFReset(shape=(2,), name="one"),
            Dense(weights=np.eye(2), name="two"),
            LIFReset(shape=(2,), name="three"),
        )
        first.s_out.connect(dense.s_in)
        dense.a_out.connect(second.a_in)
        return first

    def pair() -> Actor:
        actor, listener = Actor("none", 1), Listener()
        actor.a_out.connect(listener.a_in)
        return actor

    def said(network: Any, config: Any, allowed: tuple[type[Any], ...] = ()) -> str:
        try:
            refuse_cpu_models(network, config, allowed)
        except BackendUnavailableError as error:
            return str(error)
        return "fits"

    answers = {
        "library 2": said(library(), run_configs.Loihi2HwCfg()),
        "library 1": said(library(), run_configs.Loihi1HwCfg(select_tag="fixed_pt")),
        "pair": said(pair(), run_configs.Loihi2HwCfg()),
        "pair, one allowed": said(pair(), run_configs.Loihi1HwCfg(), (Listener,)),
    }
    vars(run_configs)["CLoihiProcessModel"] = type("CLoihiProcessModel", (), {})  # as if lava-loihi were here
    answers["library, C models"] = said(library(), run_configs.Loihi2HwCfg(select_tag="fixed_pt"))
    answers["library, C models, Dense allowed"] = said(library(), run_configs.Loihi2HwCfg(), (Dense,))
    actor = pair()
    actor.create_runtime(executable=refuse_cpu_models(actor, run_configs.Loihi2HwCfg(), (Actor, Listener)))
    actor.run(condition=RunSteps(num_steps=2))
    actor.stop()
    return {name: np.array(text) for name, text in answers.items()}


def resident() -> int:
    """Bytes of this process in memory, shared ones not counted."""
    pages = Path("/proc/self/statm").read_text(encoding="ascii").split()
    return (int(pages[1]) - int(pages[2])) * os.sysconf("SC_PAGE_SIZE")


def cycles(arrays: Arrays, options: dict[str, Any]) -> Arrays:
    """Create, run and stop a small network of the library again and again; what is held after each time."""
    from lava.magma.core.run_conditions import RunSteps
    from lava.magma.core.run_configs import Loihi2SimCfg
    from lava.proc.dense.process import Dense
    from lava.proc.lif.process import LIF

    held, seconds = [], []
    for _ in range(options["cycles"]):
        begin = time.monotonic()
        first, dense, second = LIF(shape=(4,), bias_mant=9), Dense(weights=np.eye(4)), LIF(shape=(4,))
        first.s_out.connect(dense.s_in)
        dense.a_out.connect(second.a_in)
        second.run(condition=RunSteps(num_steps=3), run_cfg=Loihi2SimCfg(select_tag="fixed_pt"))
        second.stop()
        seconds.append(time.monotonic() - begin)
        own = [name for name in os.listdir("/dev/shm") if Path.cwd().name in name]
        counts = len(own), len(os.listdir("/proc/self/fd")), threading.active_count()
        held.append((resident(), len(multiprocessing.active_children()), *counts))
        report(1)
    return {"held": np.array(held), "seconds": np.array(seconds)}
