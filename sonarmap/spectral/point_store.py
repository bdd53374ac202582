"""Storage for the points of many scans: in memory up to a limit, beyond it in memory-mapped files."""

import os
import tempfile

import numpy as np

from sonarmap.kernels.errors import InputError

_IN_MEMORY = 1 << 26  # bytes of scans to keep in memory; further ones go to disk
_CHUNK = 1 << 26  # size of a mapped file [bytes]
_ALIGNED = 64  # alignment of arrays in a file [bytes]


class PointStore:
    """Stores arrays, the first `in_memory` bytes in memory; each stays valid as long as it is referenced."""

    def __init__(self, in_memory: int = _IN_MEMORY) -> None:
        self._left = in_memory
        self._chunk: np.ndarray | None = None
        self._used = 0

    def keep(self, array: np.ndarray) -> np.ndarray:
        """The stored array, of the same values, to use instead. Raises InputError if the disk is full."""
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
    """Array (size,) uint8 in a temporary file, which is deleted with its last reference."""
    try:
        with tempfile.TemporaryFile(prefix="sonarmap.") as file:
            if hasattr(os, "posix_fallocate"):
                os.posix_fallocate(file.fileno(), 0, size)  # else a full disk would kill the process later
            return np.memmap(file, np.uint8, "r+", shape=(size,)).view(np.ndarray)
    except OSError as error:
        raise InputError(
            f"scans take more than {_IN_MEMORY >> 20} MiB, and {tempfile.gettempdir()} has no room for the rest: "
            f"{error.strerror or error}. Make room there, or set TMPDIR to another folder."
        ) from error
