"""Time that does not grow where the machine is busy, and bounds of it and of memory."""

import os
import tracemalloc
from collections.abc import Iterator
from contextlib import contextmanager

MOST_SECONDS, MOST_BYTES = 5.0, 200e6


def processor_time() -> float:
    """What this process, and those of its own that have ended, have computed [s]."""
    return sum(os.times()[:4])


@contextmanager
def quick(most: float = MOST_SECONDS) -> Iterator[None]:
    """The block takes little time [s]."""
    start = processor_time()
    yield
    assert processor_time() - start < most


@contextmanager
def thrifty() -> Iterator[None]:
    """The block takes little time and memory."""
    tracemalloc.start()
    with quick():
        yield
        peak = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
    assert peak < MOST_BYTES, f"{peak / 1e6:.0f} MB"
