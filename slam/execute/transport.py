"""How scans come to workers: as they are in this process, as files to other processes of this machine."""

import pickle
import shutil
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

from kernels.errors import InputError
from slam.execute.scan_key import ScanKey
from spectral.scan import Scan


class ScanSource(Protocol):
    """Where a worker gets a scan from when it needs it."""

    def load(self) -> Scan:
        """The scan."""
        ...


class Transport(Protocol):
    """Brings each scan to the workers, once, however many pieces of work need it."""

    def source(self, scan: ScanKey, load: Callable[[], Scan]) -> Any:
        """What to hand to a worker instead of the scan: a `ScanSource`, or Dask's future of one.

        Args:
            scan: its key.
            load: gives the scan; called when it is needed, and the scan is not kept in this process.
        """
        ...


class InProcess:
    """The worker is in this process and takes scans from where they are."""

    def source(self, scan: ScanKey, load: Callable[[], Scan]) -> ScanSource:
        return _Loaded(load)


@dataclass(frozen=True, slots=True)
class _Loaded:
    load: Callable[[], Scan]


@contextmanager
def spooled(folder: Path | None) -> Iterator[Transport]:
    """Files that other processes of this machine read, for as long as the block lasts.

    Args:
        folder: where; None for a new one in the system's folder for temporary files.
    """
    spool = _Spool(folder)
    try:
        yield spool
    finally:
        spool.remove()


class _Spool:
    """A file for every scan, written when it is needed first; the folder is made with the first, for this user only."""

    def __init__(self, folder: Path | None) -> None:
        self._folder = folder
        self._files: dict[ScanKey, SpooledScan] = {}

    def source(self, scan: ScanKey, load: Callable[[], Scan]) -> "SpooledScan":
        if scan not in self._files:
            self._files[scan] = self._write(load())
        return self._files[scan]

    def remove(self) -> None:
        """Delete all files, and the folder."""
        if self._folder is not None:
            shutil.rmtree(self._folder, ignore_errors=True)
        self._files.clear()

    def _write(self, scan: Scan) -> "SpooledScan":
        try:
            if self._folder is None:
                self._folder = Path(tempfile.mkdtemp(prefix="sonarmap."))
            self._folder.mkdir(mode=0o700, exist_ok=True)
            path = self._folder / f"{len(self._files)}.scan"
            path.write_bytes(pickle.dumps(scan, pickle.HIGHEST_PROTOCOL))
        except OSError as error:
            raise InputError(
                f"cannot write {scan.name} to {self._folder}, from where `workers` read scans: "
                f"{error.strerror or error}. Make room, or register in one process."
            ) from error
        return SpooledScan(path)


@dataclass(frozen=True, slots=True)
class SpooledScan:
    """A scan in a file that `_Spool` wrote."""

    path: Path

    def load(self) -> Scan:
        return pickle.loads(self.path.read_bytes())
