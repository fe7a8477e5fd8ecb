"""Sharing presentations among threads: compiled kernels release Python's lock, and no result depends on the split."""

from __future__ import annotations

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

T = TypeVar("T")


def cores() -> int:
    """Processors that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def share(run: Callable[[slice], T], n: int, threads: int) -> list[T]:
    """``run`` on consecutive slices of 0..n-1, one a thread; results in order."""
    size = max(1, -(-n // max(1, threads)))
    parts = [slice(start, min(n, start + size)) for start in range(0, n, size)]
    if len(parts) <= 1:
        return [run(part) for part in parts]
    with ThreadPoolExecutor(len(parts)) as pool:
        return list(pool.map(run, parts))
