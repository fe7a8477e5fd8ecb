"""The stand-in for NxSDK refuses as the chip would: what no row of the table of hardware has."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest
from support.boards.kapoho_board import Board

UNSHOWN = "is shown by no public source; ask for it by name"


@pytest.fixture
def nxsdk(board: Board) -> Any:
    """The stand-in's board class, its error and what it is told; the fixture ``board`` has it on the path."""
    from nxsdk_standin.board import N2Board
    from nxsdk_standin.faults import FAULTS, StandinError

    FAULTS.choose()
    return SimpleNamespace(N2Board=N2Board, faults=FAULTS, error=StandinError)


def core_of(nxsdk: Any, synapses: int = 4) -> Any:
    made = nxsdk.N2Board(1, 2, [2, 1], [[synapses, synapses], [synapses]])
    return made, made.n2Chips[0].n2CoresAsList[0]


@pytest.mark.parametrize(
    ("register", "values", "said"),
    [
        ("synapseFmt", {"fanoutType": 3}, "fanoutType 3 is not 1 (nengo-loihi 1.1.0 "),
        ("synapseFmt", {"fanoutType": 0}, "fanoutType 0 is not 1 (nengo-loihi 1.1.0 "),
        (
            "synapseFmt",
            {"compression": 0},
            f"compression 0: rows with indices, of discrete axons {UNSHOWN}",
        ),
        ("synapseFmt", {"compression": 1}, "compression 1 is not 3 (nengo-loihi 1.1.0 "),
        (
            "synapseFmt",
            {"wgtBits": 6},
            f"wgtBits 6: weights of fewer than 8 bits {UNSHOWN}",
        ),
        ("synapseFmt", {"wgtBits": 8}, "wgtBits 8 is not 7 (nengo-loihi 1.1.0 "),
        (
            "synapseFmt",
            {"idxBits": 0},
            f"idxBits 0: rows without indices {UNSHOWN}",
        ),
        ("synapseFmt", {"idxBits": 8}, "idxBits 8 is not 1 to 7 (nengo-loihi 1.1.0 "),
        ("synapseFmt", {"wgtExp": 8}, "wgtExp 8 is not -7 to 7 (nengo-loihi 1.1.0 "),
        ("synapseFmt", {"numSynapses": 62}, "numSynapses 62 is not 63 (nengo-loihi 1.1.0 "),
        ("synapseFmt", {"learningCfg": 1}, "learningCfg 1 is not 0 (nengo-loihi 1.1.0 "),
        ("cxProfileCfg", {"decayU": 4096}, "decayU 4,096 is not 0 to 4,095"),
        ("cxProfileCfg", {"refractDelay": 0}, "refractDelay 0 is not 1 to 63"),
        ("cxCfg", {"bias": 4096}, "bias 4,096 is not -4,095 to 4,095"),
        ("cxMetaState", {"phase0": 1}, "phase0 1 is not 2"),
        ("synapses", {"Wgt": 256}, "Wgt 256 is not -256 to 255"),
        ("synapses", {"synFmtId": 0}, "synFmtId 0 is not 1 to 15"),
    ],
)
def test_registers_hold_what_their_rows_say(nxsdk: Any, register: str, values: dict[str, int], said: str) -> None:
    """And of a synapse format what a public source shows."""
    _, core = core_of(nxsdk)
    with pytest.raises(nxsdk.error) as caught:
        getattr(core, register)[0].configure(**values)
    assert said in str(caught.value)


def test_what_is_unproven_is_taken_where_it_is_asked_for(nxsdk: Any) -> None:
    nxsdk.faults.choose(asked=["rows without indices"])
    _, core = core_of(nxsdk)
    core.synapseFmt[1].idxBits = 0
    nxsdk.faults.choose(asked=["another kind"])
    with pytest.raises(nxsdk.error, match="rows without indices is shown by no public source"):
        core.synapseFmt[2].idxBits = 0


def test_a_core_has_as_many_registers_as_the_rows_say(nxsdk: Any) -> None:
    _, core = core_of(nxsdk)
    for register, limit in (("cxProfileCfg", 32), ("vthProfileCfg", 8), ("synapseFmt", 16), ("synapseMap", 4096)):
        with pytest.raises(nxsdk.error, match=rf"{limit}\] is not in 0..{limit - 1}"):
            getattr(core, register)[limit]
