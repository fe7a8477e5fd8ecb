"""Channels of bounded size between the host and the embedded processors, with their faults."""

from __future__ import annotations

import threading
from collections import deque
from typing import Any

import numpy as np

from nxsdk_standin.faults import FAULTS, StandinError

QUERY, SUM = 2, 7


class Traffic:
    """What all channels of a board share."""

    def __init__(self) -> None:
        self.changed = threading.Condition()
        self.error: BaseException | None = None
        self.open = False
        self.read = 0

    def stop(self, error: BaseException) -> None:
        """Let nobody wait any more; the first error stays."""
        with self.changed:
            self.error = self.error or error
            self.changed.notify_all()

    def check(self) -> None:
        """Raise what went wrong elsewhere."""
        if self.error is not None:
            raise self.error
        if 0 <= FAULTS.vanish_after <= self.read:
            raise OSError(19, "No such device")


class Channel:
    """One direction between the host and one chip's program."""

    def __init__(self, traffic: Traffic, name: bytes, numElements: int, messageSize: int, slack: int) -> None:
        if not isinstance(name, bytes) or messageSize % 4 or min(numElements, messageSize, slack) < 1:
            raise StandinError(f"createChannel({name!r}, {numElements}, {messageSize}, {slack})")
        self.traffic, self.name, self.words, self.room = traffic, name.decode(), messageSize // 4, slack
        self.messages: deque[np.ndarray[Any, Any]] = deque()
        self.snip: Any = None
        self.to_chip = False
        self.sent = 0
        self.held: np.ndarray[Any, Any] | None = None

    def connect(self, source: Any, target: Any) -> None:
        """None is the host."""
        if self.snip is not None or (source is None) == (target is None):
            raise StandinError(f"channel {self.name} is connected twice, or not to one program")
        self.to_chip, self.snip = source is None, target if source is None else source

    def write(self, n: int, words: list[int]) -> None:
        """From the host."""
        if FAULTS.counts_words:
            n = n // self.words
            words = words[: n * self.words]
        if not self.to_chip or not self.traffic.open or len(words) != n * self.words:
            raise StandinError(f"channel {self.name}: write({n}, {len(words)} words)")
        if any(type(word) is not int or not -(1 << 31) <= word < 1 << 31 for word in words):
            raise StandinError(f"channel {self.name}: not 32-bit integers")
        for i in range(0 if FAULTS.one_word and self.words > 1 else n):
            for message in self._faulty(np.array(words[i * self.words : (i + 1) * self.words], np.int32)):
                self.put(message)

    def _faulty(self, message: np.ndarray[Any, Any]) -> list[np.ndarray[Any, Any]]:
        """What arrives of a packet to a chip."""
        number, self.sent = self.sent, self.sent + 1
        if not self.name.endswith("0"):
            return [message]
        if number == FAULTS.lose:
            return []
        if number == FAULTS.damage:
            message[8] += 1
        if self.held is not None:
            message, self.held = self.held, None
        elif number == FAULTS.repeat:
            self.held = message.copy()
        return [message]

    def read(self, n: int) -> list[int]:
        """By the host."""
        if self.to_chip or not self.traffic.open:
            raise StandinError(f"channel {self.name}: read({n})")
        words: list[int] = []
        for _ in range(n // self.words if FAULTS.counts_words else n):
            words += self.get().tolist()
            self.traffic.read += 1
        self.traffic.check()
        return words

    def probe(self) -> bool:
        """Whether a read would not wait."""
        self.traffic.check()
        return bool(self.messages) and not 0 <= FAULTS.silent_after <= self.traffic.read

    def put(self, message: np.ndarray[Any, Any]) -> None:
        """Wait for room."""
        if not self.to_chip:
            number, self.sent = self.sent, self.sent + 1
            if number == FAULTS.wrong_query and self.name.endswith("0"):
                message[QUERY] += 1
                message[SUM] += 2 * QUERY + 1
        with self.traffic.changed:
            self.traffic.changed.wait_for(lambda: len(self.messages) < self.room or self.traffic.error is not None)
            self.traffic.check()
            self.messages.append(message)
            self.traffic.changed.notify_all()

    def __getattribute__(self, name: str) -> Any:
        if name == "probe" and FAULTS.no_probe:
            raise AttributeError(name)
        return super().__getattribute__(name)

    def get(self) -> np.ndarray[Any, Any]:
        """Wait for a message."""
        with self.traffic.changed:
            self.traffic.changed.wait_for(lambda: bool(self.messages) or self.traffic.error is not None)
            self.traffic.check()
            message = self.messages.popleft()
            self.traffic.changed.notify_all()
            return message
