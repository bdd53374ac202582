"""Points of many scans, in memory as long as they are few, else on disk: they are read back where they are used."""

import mmap
import os
import tempfile
from collections.abc import Iterable, Iterator
from threading import Lock
from typing import TypeVar
from weakref import WeakSet

import numpy as np

from sonarmap.kernels.errors import InputError

_Scan = TypeVar("_Scan")

# What scans may take of memory; of more the rest is on disk. A file is mapped in chunks of so much.
_IN_MEMORY, _CHUNK = 1 << 26, 1 << 26
_ALIGNED = 64  # bytes
_TOGETHER = 200  # scans after which what was read of files leaves the memory
_CHUNKS, _LOCK = WeakSet[mmap.mmap](), Lock()  # of all threads


class PointStore:
    """Keeps arrays; they stay valid for as long as anything refers to them, and a file ends with the last of them.
    `in_memory`: bytes of arrays that are kept as they are."""

    def __init__(self, in_memory: int = _IN_MEMORY) -> None:
        self._left = in_memory
        self._chunk: np.ndarray | None = None
        self._used = 0

    def keep(self, array: np.ndarray) -> np.ndarray:
        """The same values, from now on. Raises InputError: there is no room on disk."""
        self._left -= array.nbytes
        if self._left >= 0:
            return array
        if self._chunk is None or self._used + array.nbytes > len(self._chunk):
            let_go()
            self._chunk, self._used = _new_chunk(max(_CHUNK, array.nbytes)), 0
        place = self._chunk[self._used : self._used + array.nbytes].view(array.dtype).reshape(array.shape)
        place[...] = array
        place.flags.writeable = False
        self._used += -(-array.nbytes // _ALIGNED) * _ALIGNED
        return place


def in_turn(scans: Iterable[_Scan], together: int = _TOGETHER) -> Iterator[_Scan]:
    """Scans, or what comes of them, one after the other: of their points on disk what is read of so many together does
    not stay in memory."""
    for number, scan in enumerate(scans, 1):
        yield scan
        if number % together == 0:
            let_go()
    let_go()


def let_go() -> None:
    """Let what was read of points on disk leave this process' memory; where it is used again, it is read again."""
    with _LOCK:
        chunks = tuple(_CHUNKS)
    for chunk in chunks if hasattr(mmap, "MADV_DONTNEED") else ():
        chunk.madvise(mmap.MADV_DONTNEED)  # of a shared mapping: what was written stays in the file


def _new_chunk(size: int) -> np.ndarray:
    """(size,) uint8 in a file without a name, which is gone when nothing refers to it."""
    try:
        with tempfile.TemporaryFile(prefix="sonarmap.") as file:
            if hasattr(os, "posix_fallocate"):
                os.posix_fallocate(file.fileno(), 0, size)  # or a full disk would end the process later
            else:
                file.truncate(size)
            chunk = mmap.mmap(file.fileno(), size)
    except OSError as error:
        raise InputError(
            f"scans take more than {_IN_MEMORY >> 20} MiB, and {tempfile.gettempdir()} has no room for the rest: "
            f"{error.strerror or error}. Make room there, or set TMPDIR to another folder."
        ) from error
    with _LOCK:
        _CHUNKS.add(chunk)
    return np.frombuffer(chunk, np.uint8)
