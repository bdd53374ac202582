"""Packages beyond sonarmap's own: kept from printing, and bound to one thread."""

import ctypes
import os
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager


@contextmanager
def silent(streams: Sequence[int] = (1,)) -> Iterator[None]:
    """What is written to the standard output (1), or also to the standard error (2), within goes nowhere.

    Also what C and C++ write.
    """
    sys.stdout.flush()
    sys.stderr.flush()
    kept, nowhere = {stream: os.dup(stream) for stream in streams}, os.open(os.devnull, os.O_WRONLY)
    for stream in streams:
        os.dup2(nowhere, stream)
    try:
        yield
    finally:
        ctypes.CDLL(None).fflush(None)  # C holds it back where stdout is no terminal
        for stream, before in kept.items():
            os.dup2(before, stream)
            os.close(before)
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
