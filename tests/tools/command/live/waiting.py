"""Waiting for what another process or thread does."""

import time
from collections.abc import Callable


def until(is_so: Callable[[], object], seconds: float = 120.0) -> None:
    """Wait until `is_so` returns a true value; fail after `seconds`."""
    end = time.monotonic() + seconds
    while not is_so():
        assert time.monotonic() < end
        time.sleep(0.01)
