"""Keys of scans, and the transport of scans to workers: within this process, or by files to other processes of this
machine. Scans with the same key give the same results, whatever their names."""

import hashlib
import json
import shutil
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

import numpy as np
from scipy.spatial.transform import RigidTransform

from sonarmap.kernels.errors import DeviceError, InputError
from sonarmap.spectral.scan import PosePrior, Scan


@dataclass(frozen=True, slots=True)
class ScanKey:
    """The reference to a scan in a piece of work."""

    content: str  # digest of the scan's content (`content_key`)
    name: str  # the scan's name, for messages


def scan_key(scan: Scan) -> ScanKey:
    return ScanKey(content_key(scan), scan.name)


def content_key(scan: Scan) -> str:
    """Digest of the arrays and the prior of a scan, without its stamp and its name."""
    prior = scan.prior
    pose = prior and prior.T_world_sensor.as_matrix()
    parts = [scan.points, scan.strength, scan.viewpoints, pose, prior and prior.sigmas]
    parts += [] if scan.times is None else [scan.times]
    digest = hashlib.sha256()
    for part in parts:
        # pyrefly: ignore[missing-attribute]
        digest.update(b"none;" if part is None else f"{part.dtype.str}{part.shape};".encode())
        digest.update(b"" if part is None else np.ascontiguousarray(part).tobytes())
    return digest.hexdigest()


def joined_key(*keys: str) -> str:
    return hashlib.sha256("\0".join(keys).encode()).hexdigest()


_ARRAYS = ("points", "strength", "viewpoints", "times")


class ScanSource(Protocol):
    """Loads a scan when a worker needs it."""

    def load(self) -> Scan: ...


class Transport(Protocol):
    """Brings each scan to the workers, once, however many pieces of work need it."""

    def source(self, scan: ScanKey, load: Callable[[], Scan]) -> ScanSource:
        """The source to hand to a worker instead of the scan.

        Args:
            load: returns the scan; called when the scan is needed. This process does not keep the scan.
        """
        ...


class InProcess:
    """Transport to a worker in this process, which loads scans directly."""

    def source(self, scan: ScanKey, load: Callable[[], Scan]) -> ScanSource:
        # pyrefly: ignore[bad-return]
        return _Loaded(load)


@dataclass(frozen=True, slots=True)
class _Loaded:
    load: Callable[[], Scan]


@contextmanager
def spooled(folder: Path | None) -> "Iterator[_Spool]":
    """Transport by files to other processes of this machine, for as long as the block lasts.

    Args:
        folder: beginning of the path of the new folder; None for one in the system's folder for temporary files.
    """
    spool = _Spool(Path(tempfile.gettempdir()) / "sonarmap." if folder is None else folder)
    try:
        yield spool
    finally:
        spool.remove()


class _Spool:
    """One file for every scan, written when it is first needed, in a folder that is made with the first file.

    The folder is new, has a random name and belongs to this user only, so that no other files are read or overwritten.
    """

    def __init__(self, beginning: Path) -> None:
        self._beginning = beginning
        self._folder: Path | None = None
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
                self._folder = Path(tempfile.mkdtemp(prefix=self._beginning.name, dir=self._beginning.parent))
            written = SpooledScan(self._folder / f"{len(self._files)}.npz")
            written.save(scan)
        except OSError as error:
            raise InputError(
                f"cannot write {scan.name} to {self._beginning.parent}, from where `workers` read scans: "
                f"{error.strerror or error}. Make room, or register in one process."
            ) from error
        return written


@dataclass(frozen=True, slots=True)
class SpooledScan:
    """A scan in a file of its own: arrays as NumPy's .npz, the rest as JSON in it.

    Nothing in it is pickled, so that a manipulated file cannot run code.
    """

    path: Path

    def save(self, scan: Scan) -> None:
        arrays = {name: array for name in _ARRAYS if (array := getattr(scan, name)) is not None}
        if scan.prior is not None:
            arrays |= {"pose": scan.prior.T_world_sensor.as_matrix(), "sigmas": scan.prior.sigmas}
        rest = json.dumps({"name": scan.name, "stamp": float(scan.stamp)})
        np.savez(self.path, rest=np.array(rest), **arrays)

    def load(self) -> Scan:
        """The scan.

        Raises:
            DeviceError: the file was removed or changed, which is not the scan's fault.
        """
        try:
            with np.load(self.path, allow_pickle=False) as file:
                content = dict(file)
            prior = None
            if "pose" in content:
                # normalizing again might change the last bits
                T_world_sensor = RigidTransform(content["pose"], normalize=False)
                prior = PosePrior(T_world_sensor, content["sigmas"])
            arrays = {name: content.get(name) for name in _ARRAYS}
            # pyrefly: ignore[bad-argument-type]
            return Scan(**arrays, prior=prior, **json.loads(str(content["rest"])))
        except Exception as error:  # a changed file may raise anything
            raise DeviceError(
                f"{self.path}, from where `workers` read a scan, was removed or changed ({error}). Leave the output "
                "folder as it is while it is written to, and run the same command again."
            ) from error
