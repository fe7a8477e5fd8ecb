"""The packets between host and embedded processors; `embedded.c` says what they mean and has the same numbers."""

import numpy as np

WORDS, PAYLOAD, MAGIC = 64, 8, 0x4C560100
ROOM = WORDS - PAYLOAD
KIND, RUN, QUERY, NUMBER, LENGTH, FIRST, SECOND, SUM = range(PAYLOAD)
BEGIN, SPIKES, SET, READY, COUNTS, FAULT, BIAS = range(1, 8)
FAULTS = ("", "checksum", "kind", "run", "query", "number", "length", "value", "bundle", "count")
MESSAGE_BYTES, SLACK = 4 * WORDS, 16
CHUNK = SLACK // 2  # packets sent to one chip while another waits: they must fit the channel


def checksums(packets: np.ndarray) -> np.ndarray:
    """Weighted sum of each packet's words but the checksum itself, int32."""
    weights = 2 * np.arange(WORDS, dtype=np.uint64) + np.uint64(1)
    weights[SUM] = 0
    sums = (packets.astype(np.int32).view(np.uint32).astype(np.uint64) * weights).sum(axis=1)
    return (sums & np.uint64(0xFFFFFFFF)).astype(np.uint32).view(np.int32)


def packed(head: tuple, numbers: range, payloads: list, words: tuple) -> np.ndarray:
    """A packet for each of ``payloads``, int32 (n, WORDS).

    Args:
        head: Kind, run and query.
        numbers: Their numbers.
        payloads: At most ROOM words each.
        words: The two words beside.
    """
    packets = np.zeros((len(payloads), WORDS), np.int32)
    packets[:, :NUMBER] = (MAGIC + head[0], *head[1:])
    packets[:, NUMBER] = numbers
    packets[:, FIRST:SUM] = words
    for packet, payload in zip(packets, payloads):  # noqa: B905 (3.6 lacks strict)
        packet[LENGTH] = len(payload)
        packet[PAYLOAD : PAYLOAD + len(payload)] = payload
    packets[:, SUM] = checksums(packets)
    return packets


def pieces(values: np.ndarray, size: int) -> list:
    """``values`` in pieces of ``size``; the last may be shorter."""
    return [values[i : i + size] for i in range(0, len(values), size)]
