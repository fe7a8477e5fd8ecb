"""The wiring that every place network has in common, whatever its parts are."""

from __future__ import annotations

from typing import Any

RELAY_WEIGHT = 2
"""Weight of the synapses from exc to inh. Any positive one makes a relay spike; an even one does in every sign mode."""


def connect(excite: Any, exc: Any, relay: Any, inh: Any, inhibit: Any) -> None:
    """Connect the parts of a place network: exc to inh, one to one; inh to all other exc. Every arrow takes one step.

    Args:
        excite, relay, inhibit: Connections, with ``s_in`` and ``a_out``.
        exc, inh: Populations, with ``a_in`` and ``s_out``.
    """
    for connection, population in ((excite, exc), (relay, inh), (inhibit, exc)):
        connection.a_out.connect(population.a_in)
    exc.s_out.connect(relay.s_in)
    inh.s_out.connect(inhibit.s_in)


def wire(proc: Any, excite: Any, exc: Any, relay: Any, inh: Any, inhibit: Any) -> None:
    """Make a network of its parts: `connect` them, and let the network's ports and Vars be theirs.

    Args:
        proc: The network, with the ports ``s_in``, ``s_out``, ``s_out_inh`` and the Vars ``weights``, ``u``, ``v``,
            ``vth`` and ``v_inh``, which become those of its parts.
        excite, exc, relay, inh, inhibit: As `connect` takes them.
    """
    connect(excite, exc, relay, inh, inhibit)
    proc.s_in.connect(excite.s_in)
    exc.s_out.connect(proc.s_out)
    inh.s_out.connect(proc.s_out_inh)
    proc.vars.weights.alias(excite.weights)
    proc.vars.u.alias(exc.u)
    proc.vars.v.alias(exc.v)
    proc.vars.vth.alias(exc.vth)
    proc.vars.v_inh.alias(inh.v)
