"""Gains of inputs in Lava as functions of arrays and options, to be called in a process of their own.

Each takes ``arrays``: ``digits`` uint16 (n, digits, inputs) of `lava_vpr.engine.gains.Digits`, ``gains`` uint8 (epochs,
inputs), and the ``epoch`` of each query, int32 (n,), in any order; and ``options``: ``tag``. Each returns ``gained``,
the products, int64 (n, digits, inputs).
"""

from __future__ import annotations

from typing import Any

import numpy as np
from lava.proc.io.source import RingBuffer
from numpy.typing import NDArray

from lava_vpr.isolated.worker import report
from lava_vpr.processes.base.magma import FIXED_TAG, RunSteps
from lava_vpr.processes.input_gains.process import InputGains
from lava_vpr.processes.jobs.inference import Arrays, Way, begin

_INTERVAL = 2
"""Steps in which a digit is sent, and arrives."""


def _multiplied(digits: NDArray[np.uint16], gains: NDArray[np.uint8], way: Way) -> NDArray[np.int64]:
    """The products (n, digits, inputs) with the gains of one epoch: a run of Lava, a presentation of each digit."""
    n, inputs = len(digits), digits.shape[2]
    sent = np.zeros((inputs, digits.shape[0] * digits.shape[1], _INTERVAL), np.int32)
    sent[:, :, 0] = digits.reshape(-1, inputs).T
    source, product = RingBuffer(data=sent.reshape(inputs, -1)), InputGains(gains=gains, interval=_INTERVAL)
    source.s_out.connect(product.s_in)
    config, gained = begin(product, way), np.zeros(digits.shape, np.int64)
    for query in range(n):
        for digit in range(digits.shape[1]):
            product.run(condition=RunSteps(num_steps=_INTERVAL), run_cfg=config)
            gained[query, digit] = product.gained(way.floating)
        report(1)
    product.stop()
    return gained


def _gained(arrays: Arrays, options: dict[str, Any], library: bool) -> Arrays:
    """Epoch after epoch."""
    digits, gains, epoch = (arrays[name] for name in ("digits", "gains", "epoch"))
    way, gained = Way(str(options.get("tag", FIXED_TAG)), library), np.zeros(digits.shape, np.int64)
    for number in np.unique(epoch):
        chosen = epoch == number
        gained[chosen] = _multiplied(digits[chosen], gains[number], way)
    return {"gained": gained}


def composed(arrays: Arrays, options: dict[str, Any]) -> Arrays:
    """The products of this project's Processes."""
    return _gained(arrays, options, library=False)


def library(arrays: Arrays, options: dict[str, Any]) -> Arrays:
    """The same with Lava's library in their place."""
    return _gained(arrays, options, library=True)
