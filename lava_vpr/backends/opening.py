"""Models opened to be asked: from a file or a deployed bundle, and the calibration of their answers."""

from __future__ import annotations

from pathlib import Path

from lava_vpr import model as model_file
from lava_vpr.cluster.tasks import ONE_THREAD, Pool
from lava_vpr.matching.probability import Calibration
from lava_vpr.model import Model, as_integer


def open_model(path: str | Path) -> Model:
    """The model in a file, or in the folder of a deployed bundle.

    Args:
        path: A model file, or a bundle's folder.
    Raises:
        ModelFileError: it cannot be used.
    """
    if not Path(path).is_dir():
        return model_file.load(path)
    from lava_vpr.deploy.bundle.opening import open_bundle  # only those who have a bundle wait for it

    return open_bundle(Path(path))


def calibration_of(model: Model, pool: Pool = ONE_THREAD) -> Calibration | None:
    """The calibration of ``model``: what it holds, or measured now; None for the float conductance model.

    Args:
        model: A model, of any origin.
        pool: Who measures; it does not change the result.
    """
    integer = as_integer(model)
    if model.calibration is not None or integer is None:
        return None if model.calibration is None else Calibration(model.calibration)
    from lava_vpr.training.measuring import measured  # a model that holds it, as its file does, need not wait for it

    return measured(integer, pool)
