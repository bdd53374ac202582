"""What others' libraries print must not stand between the lines of a result; and how many threads they take."""

import ctypes
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def silent() -> Iterator[None]:
    """What is written to the standard output within, also by C and C++, goes nowhere."""
    sys.stdout.flush()
    kept, nowhere = os.dup(1), os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, 1)
    try:
        yield
    finally:
        ctypes.CDLL(None).fflush(None)  # C holds it back where stdout is no terminal
        os.dup2(kept, 1)
        os.close(kept)
        os.close(nowhere)


@contextmanager
def quiet() -> Iterator[None]:
    """Open3D says nothing but errors within."""
    import open3d as o3d

    with o3d.utility.VerbosityContextManager(o3d.utility.VerbosityLevel.Error):
        yield


@contextmanager
def one_thread() -> Iterator[None]:
    """Open3D is quiet within and takes one thread: what several sum up differs in its last bits from run to run."""
    import open3d as o3d

    before = o3d.utility.get_max_threads()
    o3d.utility.set_max_threads(1)
    try:
        with quiet():
            yield
    finally:
        o3d.utility.set_max_threads(before)
