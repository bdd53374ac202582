"""Processor time, which other load does not change, and limits of it and of memory."""

import os
import tracemalloc
from collections.abc import Iterator
from contextlib import contextmanager

MOST_SECONDS, MOST_BYTES = 5.0, 200e6


def processor_time() -> float:
    """Processor time of this process and of its children that have ended [s]."""
    return sum(os.times()[:4])


@contextmanager
def quick(most: float = MOST_SECONDS) -> Iterator[None]:
    """Check that the block takes less than `most` of processor time [s]."""
    start = processor_time()
    yield
    assert processor_time() - start < most


@contextmanager
def thrifty() -> Iterator[None]:
    """Check that the block takes little processor time and memory."""
    tracemalloc.start()
    with quick():
        yield
        peak = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
    assert peak < MOST_BYTES, f"{peak / 1e6:.0f} MB"
