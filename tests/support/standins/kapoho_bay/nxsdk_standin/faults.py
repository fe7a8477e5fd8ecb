"""What shall go wrong, from the environment variable STANDIN (a JSON object), and a log of what was done."""

from __future__ import annotations

import json
import os
from dataclasses import dataclass
from pathlib import Path
from typing import Any


class StandinError(RuntimeError):
    """A call or value that the chip does not have: a defect of the program under test."""


@dataclass
class Faults:
    """Attributes:
    version: Of NxSDK.
    start_fails: Attempts to start that raise.
    start_hangs: Starting never returns.
    vanish_after: The device is gone once the host has read so many packets.
    silent_after: The chips send nothing more after so many packets; -1: never.
    never_finishes: finishRun does not return.
    lose, damage, repeat: Number of the packet to chip 0 (from 0) that is lost, changed, or sent twice in place of the
        next; -1: none.
    wrong_query: Number of the packet from chip 0 that carries another query's number; -1: none.
    counts_words: channel.write and read count words, not messages.
    one_word: Channels pass nothing on whose messages have more than a word.
    no_probe: Channels have no probe, so that a read which waits cannot be interrupted.
    no_type: NxSDK's header has no type CxState.
    stale: A state that is written by itself, not with its whole core, is as it was.
    stuck: A neuron whose state was cleared stands still until its phase is written, too.
    memory: Bytes of tables that a chip's program may have; -1: any.
    sensors: The board measures its power.
    asked: Kinds of unproven values of registers that are taken all the same (`deploy.hardware.table.kind_of`).
    once: File that the first fault creates; none happens while it exists.
    log: File to which starts, runs and disconnections are appended.
    """

    version: str = "1.0.0"
    start_fails: int = 0
    start_hangs: bool = False
    vanish_after: int = -1
    silent_after: int = -1
    never_finishes: bool = False
    lose: int = -1
    damage: int = -1
    repeat: int = -1
    wrong_query: int = -1
    counts_words: bool = False
    one_word: bool = False
    no_probe: bool = False
    no_type: bool = False
    stale: bool = False
    stuck: bool = False
    memory: int = -1
    sensors: bool = True
    asked: tuple[str, ...] = ()
    once: str = ""
    log: str = ""

    def choose(self, **changes: Any) -> None:
        """Have these faults and no others from now on."""
        vars(self).update(vars(Faults(**changes)))

    def note(self, text: str) -> None:
        """Append a line to the log."""
        if self.log:
            with Path(self.log).open("a", encoding="utf-8") as file:
                file.write(text + "\n")


def _given() -> Faults:
    given = Faults(**json.loads(os.environ.get("STANDIN", "{}")))
    if given.once and Path(given.once).exists():
        return Faults(version=given.version, asked=given.asked, log=given.log)
    if given.once:
        Path(given.once).touch()
    return given


FAULTS = _given()
