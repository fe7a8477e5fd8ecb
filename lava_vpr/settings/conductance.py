"""Settings of preset ``paper``: the conductance network of VPRSNN, and how it learns.

Source: Hussaini et al. 2022 (doi 10.1109/LRA.2022.3149030) and its released code.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Literal

from lava_vpr.settings.ranges import Range, check


@dataclass(frozen=True)
class ConductanceNetwork:
    """VPRSNN's conductance model; times in ms, potentials in mV, conductances without unit.

    It is as coded but for three things: every presentation starts from rest, delays of training are kept for testing,
    and spikes of the rest are not carried over to the next image (`lava_vpr.engine.conductance.model`).

    Attributes:
        neurons: Excitatory neurons (as many inhibitory ones).
        steps: Steps of ``dt_ms`` with input; ``rest_steps`` without follow.
        tau_gi_ms: 2.0 in the 2022 release, 0.5 in the later one.
        delay_max_ms: Input delays are drawn once from U(0, delay_max_ms) and saved with the model.
        timer_rate: The released code's refractory timer advances at this share of real time, which makes its 5 ms
            an effective 50 ms.
    """

    model: Literal["conductance"] = "conductance"
    neurons: Annotated[int, Range(1, 100_000)] = 400
    dt_ms: Annotated[float, Range(0.01, 1)] = 0.1
    steps: Annotated[int, Range(1, 1_000_000)] = 3500
    rest_steps: Annotated[int, Range(0, 1_000_000)] = 1500
    tau_ge_ms: Annotated[float, Range(0.1, 1000)] = 1.0
    tau_gi_ms: Annotated[float, Range(0.1, 1000)] = 2.0
    delay_max_ms: Annotated[float, Range(0, 100)] = 10.0
    timer_rate: Annotated[float, Range(0.001, 1)] = 0.1

    def __post_init__(self) -> None:
        check(self, "network")


@dataclass(frozen=True)
class ConductanceLearning:
    """How the conductance model learns: the released code's ``triplet`` rule, or the ``paper``'s equation.

    ``triplet``: pre spike ``w += eta_pre post1``; post spike ``w += eta_post x_pre post2``. ``paper``:
    ``w += eta_post (x_pre - x_target) (w_max - w)^mu`` on a post spike. `label_epochs`: S^R is the spike counts of
    that many last epochs, plasticity still on.
    """

    rule: Annotated[Literal["triplet", "paper"], "with this network"] = "triplet"
    arithmetic: Annotated[Literal["float"], "with the paper preset"] = "float"
    epochs: Annotated[int, Range(1, 10_000)] = 60
    label_epochs: Annotated[int, Range(1, 10_000)] = 3
    eta_pre: Annotated[float, Range(0, 1)] = 1e-4
    eta_post: Annotated[float, Range(0, 1)] = 1e-2
    x_target: Annotated[float, Range(0, 1)] = 0.4
    mu: Annotated[float, Range(0, 8)] = 0.2
    w_max: Annotated[float, Range(0, 1000, "least")] = 1.0
    weight_sum: Annotated[float, Range(0, 1_000_000, "least")] = 78.0
    theta_start_mv: Annotated[float, Range(0, 1000, "least")] = 20.0
    theta_plus_mv: Annotated[float, Range(0, 100)] = 0.05
    tau_theta_ms: Annotated[float, Range(1, 1e30)] = 1e7

    def __post_init__(self) -> None:
        check(self, "learning")
