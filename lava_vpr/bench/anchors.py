"""Published figures of other networks: spiking ones on Loihi, and ones that recognise places on other hardware.

No two of them are the same task on the same board: they show the order of magnitude, not which network is better.
Figures are the authors' own, as published; nothing is converted but units.
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Anchor:
    """A published result of other hardware, printed beside ours.

    Attributes:
        name: Authors and year.
        task: What was done, with what network.
        board: The hardware that it ran on.
        kind: ``measured`` by the authors, or ``hoped for``.
        microjoules: Energy of one answer, as published; None: not published.
        milliseconds: Time of one answer, as published; None: not published.
        note: What else was published.
        citation, doi: Where it was published.
    """

    name: str
    task: str
    board: str
    kind: str
    microjoules: float | None
    milliseconds: float | None
    note: str
    citation: str
    doi: str


_RENNER = (
    "Renner et al., The backpropagation algorithm implemented on spiking neuromorphic hardware, Nature Communications "
    "2024"
)
_RENNER_DOI = "10.1038/s41467-024-53827-9"
_VPRSNN = (
    "Hussaini, Milford, Fischer, Spiking Neural Networks for Visual Place Recognition via Weighted Neuronal "
    "Assignments, IEEE Robotics and Automation Letters 2022"
)
_VPRSNN_DOI = "10.1109/LRA.2022.3149030"

ANCHORS: tuple[Anchor, ...] = (
    Anchor(
        name="Renner 2024",
        task="digits (MNIST), network 400-400-10, inference",
        board="Loihi 1",
        kind="measured",
        microjoules=2.5,
        milliseconds=0.17,
        note="",
        citation=_RENNER,
        doi=_RENNER_DOI,
    ),
    Anchor(
        name="Renner 2024, learning",
        task="the same network while it learns on the chip",
        board="Loihi 1",
        kind="measured",
        microjoules=590.0,
        milliseconds=1.5,
        note="",
        citation=_RENNER,
        doi=_RENNER_DOI,
    ),
    Anchor(
        name="Lin 2018",
        task="digits (MNIST), inference",
        board="Loihi 1",
        kind="measured",
        microjoules=12.8,
        milliseconds=None,
        note="",
        citation="Lin et al., Programming Spiking Neural Networks on Intel's Loihi, Computer 51(3), 2018",
        doi="10.1109/MC.2018.157113521",
    ),
    Anchor(
        name="Shrestha 2021",
        task="image classes, a multilayer network that was trained on the chip",
        board="Loihi 1",
        kind="measured",
        microjoules=2470.0,
        milliseconds=10.0,
        note="",
        citation="Shrestha et al., In-Hardware Learning of Multilayer Spiking Neural Networks on a Neuromorphic "
        "Processor, Design Automation Conference 2021",
        doi="10.1109/DAC18074.2021.9586323",
    ),
    Anchor(
        name="Blouw 2019",
        task="keyword spotting in speech, inference",
        board="Loihi 1",
        kind="measured",
        microjoules=270.0,
        milliseconds=None,
        note="296 inferences a second",
        citation="Blouw et al., Benchmarking Keyword Spotting Efficiency on Neuromorphic Hardware, NICE 2019, "
        "arXiv 1812.01739",
        doi="10.1145/3320288.3320304",
    ),
    Anchor(
        name="Frady 2020",
        task="k nearest neighbours of image descriptors",
        board="Pohoiki Springs, many Loihi 1",
        kind="measured",
        microjoules=None,
        milliseconds=None,
        note="5.8 to 13 us a step of the network",
        citation="Frady et al., Neuromorphic Nearest Neighbor Search Using Intel's Pohoiki Springs, NICE 2020",
        doi="10.1145/3381755.3398695",
    ),
    Anchor(
        name="LoCS-Net 2024",
        task="place recognition, convolutional network; Nordland among its datasets",
        board="Kapoho Bay",
        kind="measured",
        microjoules=None,
        milliseconds=None,
        note="P@100R 78.6 % on Nordland (another part and another number of places); no energy given",
        citation="Akcal et al., LoCS-Net: localizing convolutional spiking neural network for fast visual place "
        "recognition, Frontiers in Neurorobotics 2024",
        doi="10.3389/fnbot.2024.1490267",
    ),
    Anchor(
        name="VPRTempo 2024",
        task="place recognition, a code of spike times; Nordland and Oxford RobotCar, up to 27,000 places",
        board="a CPU",
        kind="measured",
        microjoules=None,
        milliseconds=None,
        note="above 50 queries a second; accuracy comparable to earlier spiking networks and NetVLAD; no energy given. "
        "What its architecture reaches on our places: make peers",
        citation="Hines, Stratton, Milford, Fischer, VPRTempo: A Fast Temporally Encoded Spiking Neural Network for "
        "Visual Place Recognition, ICRA 2024, arXiv 2309.10225",
        doi="10.48550/arXiv.2309.10225",
    ),
    Anchor(
        name="VPRSNN 2022, CPU",
        task="place recognition, the network that this project rebuilds, simulated in Brian2",
        board="a CPU",
        kind="measured",
        microjoules=None,
        milliseconds=1000.0,
        note="",
        citation=_VPRSNN,
        doi=_VPRSNN_DOI,
    ),
    Anchor(
        name="VPRSNN 2022, GPU",
        task="the same on a graphics processor",
        board="a GPU",
        kind="measured",
        microjoules=None,
        milliseconds=200.0,
        note="at 81 W",
        citation=_VPRSNN,
        doi=_VPRSNN_DOI,
    ),
    Anchor(
        name="VPRSNN 2022, hope",
        task="the same, what its authors hope for on Loihi",
        board="Loihi",
        kind="hoped for",
        microjoules=None,
        milliseconds=1.0,
        note="below 1 ms and below 1 mW; neither measured nor modelled",
        citation=_VPRSNN,
        doi=_VPRSNN_DOI,
    ),
)
