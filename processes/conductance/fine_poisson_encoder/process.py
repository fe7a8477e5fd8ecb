"""Poisson input spikes of fine time steps, drawn with 32 bits."""

from __future__ import annotations

from lava_vpr.processes.base.encoders import EncoderProcess


class FinePoissonEncoder(EncoderProcess):
    """Sends the draws of `lava_vpr.encoding.draw_spikes`, one presentation after another; then it is silent.

    Rates are in units of 2^-32. Arguments, port and Var as `lava_vpr.processes.base.encoders.EncoderProcess`.
    """

    rate_bits = 32
