"""Frozen, self-checking settings of VPRSNN's conductance model and of how it learns: preset ``paper``.

Source: Hussaini et al. 2022 (doi 10.1109/LRA.2022.3149030) and its released code.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from lava_vpr.settings.ranges import need, within


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
    neurons: int = 400
    dt_ms: float = 0.1
    steps: int = 3500
    rest_steps: int = 1500
    tau_ge_ms: float = 1.0
    tau_gi_ms: float = 2.0
    delay_max_ms: float = 10.0
    timer_rate: float = 0.1

    def __post_init__(self) -> None:
        need(self.model == "conductance", "network.model", self.model, "conductance")
        within(
            self,
            "network",
            neurons="[1, 100000]",
            dt_ms="[0.01, 1]",
            steps="[1, 1000000]",
            rest_steps="[0, 1000000]",
            tau_ge_ms="[0.1, 1000]",
            tau_gi_ms="[0.1, 1000]",
            delay_max_ms="[0, 100]",
            timer_rate="[0.001, 1]",
        )


@dataclass(frozen=True)
class ConductanceLearning:
    """How the conductance model learns: the released code's ``triplet`` rule, or the ``paper``'s equation.

    ``triplet``: pre spike ``w += eta_pre post1``; post spike ``w += eta_post x_pre post2``. ``paper``:
    ``w += eta_post (x_pre - x_target) (w_max - w)^mu`` on a post spike. `label_epochs`: S^R is the spike counts of
    that many last epochs, plasticity still on.
    """

    rule: Literal["triplet", "paper"] = "triplet"
    arithmetic: Literal["float"] = "float"
    epochs: int = 60
    label_epochs: int = 3
    eta_pre: float = 1e-4
    eta_post: float = 1e-2
    x_target: float = 0.4
    mu: float = 0.2
    w_max: float = 1.0
    weight_sum: float = 78.0
    theta_start_mv: float = 20.0
    theta_plus_mv: float = 0.05
    tau_theta_ms: float = 1e7

    def __post_init__(self) -> None:
        need(self.rule in ("triplet", "paper"), "learning.rule", self.rule, "triplet or paper with this network")
        need(self.arithmetic == "float", "learning.arithmetic", self.arithmetic, "float with the paper preset")
        within(self, "learning", epochs="[1, 10000]", label_epochs="[1, 10000]", tau_theta_ms="[1, 1e30]")
        within(
            self,
            "learning",
            eta_pre="[0, 1]",
            eta_post="[0, 1]",
            x_target="[0, 1]",
            mu="[0, 8]",
            w_max="(0, 1000]",
            weight_sum="(0, 1000000]",
            theta_start_mv="(0, 1000]",
            theta_plus_mv="[0, 100]",
        )
