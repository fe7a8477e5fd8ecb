"""Whether Lava, and Intel's closed part of it that drives Loihi, can run here; said before any work is done."""

from __future__ import annotations

import importlib.metadata
import importlib.util
import os
import sys
from typing import TYPE_CHECKING, Any

from lava_vpr.errors import BackendUnavailableError

if TYPE_CHECKING:
    from lava.magma.compiler.executable import Executable
    from lava.magma.core.process.process import AbstractProcess
    from lava.magma.core.run_configs import RunConfig

WANTED = "0.10"
PYTHON = (3, 10)
LOIHI_MODULE = "lava.utils.loihi2_profiler"  # what lava.utils.loihi.is_installed() of lava-nc 0.10 looks for
VENDOR = "it is Intel's closed package, from its neuromorphic research cloud"


def require_lava() -> None:
    """See that Lava can run here, without importing it.

    Raises:
        BackendUnavailableError: it cannot; the line says what to install.
    """
    if not hasattr(os, "fork"):
        raise BackendUnavailableError(f"Lava starts its models by fork, which {sys.platform} lacks; use Linux or WSL")
    if tuple(sys.version_info[:2]) != PYTHON:
        running = ".".join(map(str, sys.version_info[:3]))
        raise BackendUnavailableError(
            f"lava-nc {WANTED} needs Python 3.10, this is {running}; install lava-vpr under Python 3.10"
        )
    try:
        version = importlib.metadata.version("lava-nc")
    except importlib.metadata.PackageNotFoundError:
        version = None
    if version is None or importlib.util.find_spec("lava") is None:
        raise BackendUnavailableError(f"lava-nc is not installed: pip install lava-nc=={WANTED}.*")
    if version.split(".")[:2] != WANTED.split("."):
        raise BackendUnavailableError(
            f"lava-nc {version} is installed, {WANTED} is needed: pip install lava-nc=={WANTED}.*"
        )


def _loihi_installed() -> bool:
    """Whether Lava's part for Loihi is installed: `lava.utils.loihi.is_installed`, also where Lava is absent."""
    try:
        return importlib.util.find_spec(LOIHI_MODULE) is not None
    except ModuleNotFoundError:
        return False


def loihi_available() -> str | None:
    """Why Lava cannot run on Loihi here; None if it can, as far as is known without a board."""
    if not _loihi_installed():
        return f"lava-loihi is not installed; {VENDOR}"
    host = getattr(sys.modules.get("lava.utils.loihi"), "host", None)
    if host is None and os.environ.get("SLURM") != "1" and not os.environ.get("NXSDKHOST"):
        return (
            "no Loihi host is configured; call lava.utils.loihi.use_slurm_host() or use_ethernet_host(ADDRESS), "
            "or set SLURM=1 or NXSDKHOST=ADDRESS"
        )
    return None


def refuse_cpu_models(process: AbstractProcess, run_cfg: RunConfig, allowed: tuple[type[Any], ...] = ()) -> Executable:
    """Compile a network for hardware and see that none of it would run on the CPU, which Lava does without a word.

    A Process is compiled only once, so run what is returned: ``process.create_runtime(executable=...)``, then
    ``process.run(condition)``.

    Args:
        process: Any Process of the network.
        run_cfg: `Loihi1HwCfg` or `Loihi2HwCfg`.
        allowed: Classes of Processes that may run on the CPU: the source and the sink of spikes.
    Raises:
        BackendUnavailableError: Processes would run on the CPU (all are named), or Lava cannot choose models here.
    """
    from lava.magma.compiler.compiler_graphs import ProcGroupDiGraphs
    from lava.magma.core.model.py.model import AbstractPyProcessModel
    from lava.magma.core.model.sub.model import AbstractSubProcessModel

    config = type(run_cfg).__name__
    try:
        executable = process.compile(run_cfg)
    except NameError as error:
        if error.name != "CLoihiProcessModel":  # the class that run_configs.py names and cannot import
            raise
        raise BackendUnavailableError(
            f"{config} cannot choose models for the chip without lava-loihi; {VENDOR}, or use the backend lava-fixed"
        ) from None
    parts = [
        part
        for part in executable.process_list
        if issubclass(part.model_class, AbstractPyProcessModel) and not isinstance(part, allowed)
    ]
    if parts:
        on_cpu = sorted(f"{type(part).__name__} {part.name} ({part.model_class.__name__})" for part in parts)
        remedy = "write a model for the chip" if _loihi_installed() else f"install lava-loihi ({VENDOR})"
        found = (model for part in parts for model in ProcGroupDiGraphs._find_proc_models(part))
        if any(issubclass(model, AbstractSubProcessModel) for model in found):  # which the run did not ask for
            remedy = "pass select_sub_proc_model=True"
        raise BackendUnavailableError(
            f"{config} would run on the CPU: {', '.join(on_cpu)}; {remedy}, or use the backend lava-fixed"
        )
    return executable
