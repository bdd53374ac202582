"""Waiting for what another process or thread does."""

import subprocess
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any


def until(is_so: Callable[[], object], seconds: float = 120.0) -> None:
    """Wait until `is_so` returns a true value; fail after `seconds`."""
    end = time.monotonic() + seconds
    while not is_so():
        assert time.monotonic() < end
        time.sleep(0.01)


def mapping_of(process: "subprocess.Popen[Any]") -> int | None:
    """Id of the mapping process of `sonarmap live`."""
    for child in Path(f"/proc/{process.pid}/task/{process.pid}/children").read_text().split():
        with suppress(OSError):
            if b"spawn_main" in Path(f"/proc/{child}/cmdline").read_bytes():
                return int(child)
    return None
