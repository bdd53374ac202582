"""Points of many scans, in memory as long as they are few, else on disk: they are read back where they are used."""

import os
import tempfile

import numpy as np

from sonarmap.kernels.errors import InputError

_IN_MEMORY = 1 << 26  # bytes that scans may take of memory; of more the rest is on disk
_CHUNK = 1 << 26  # bytes of a file that are mapped together
_ALIGNED = 64  # bytes


class PointStore:
    """Keeps arrays, of `in_memory` bytes as they are; they stay valid for as long as anything refers to them."""

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
            self._chunk, self._used = _new_chunk(max(_CHUNK, array.nbytes)), 0
        place = self._chunk[self._used : self._used + array.nbytes].view(array.dtype).reshape(array.shape)
        place[...] = array
        place.flags.writeable = False
        self._used += -(-array.nbytes // _ALIGNED) * _ALIGNED
        return place


def _new_chunk(size: int) -> np.ndarray:
    """(size,) uint8 in a file without a name, which is gone when nothing refers to it."""
    try:
        with tempfile.TemporaryFile(prefix="sonarmap.") as file:
            if hasattr(os, "posix_fallocate"):
                os.posix_fallocate(file.fileno(), 0, size)  # or a full disk would end the process later
            return np.memmap(file, np.uint8, "r+", shape=(size,)).view(np.ndarray)
    except OSError as error:
        raise InputError(
            f"scans take more than {_IN_MEMORY >> 20} MiB, and {tempfile.gettempdir()} has no room for the rest: "
            f"{error.strerror or error}. Make room there, or set TMPDIR to another folder."
        ) from error
