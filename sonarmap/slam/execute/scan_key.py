"""A digest of what a scan holds: scans with the same key give the same results, whatever their names."""

import hashlib
from dataclasses import dataclass

import numpy as np

from sonarmap.spectral.scan import Scan


@dataclass(frozen=True, slots=True)
class ScanKey:
    """What a piece of work says instead of a scan.

    Attributes:
        content: a digest of what the scan holds, as `content_key` gives it.
        name: the scan's; messages hold it.
    """

    content: str
    name: str


def scan_key(scan: Scan) -> ScanKey:
    """The key of a scan."""
    return ScanKey(content_key(scan), scan.name)


def content_key(scan: Scan) -> str:
    """A digest of the points, strengths, viewpoints and prior of a scan; its stamp and its name decide nothing."""
    prior = scan.prior
    pose = prior and prior.T_world_sensor.as_matrix()
    parts = [scan.points, scan.strength, scan.viewpoints, pose, prior and prior.sigmas]
    digest = hashlib.sha256()
    for part in parts:
        digest.update(b"none;" if part is None else f"{part.dtype.str}{part.shape};".encode())
        digest.update(b"" if part is None else np.ascontiguousarray(part).tobytes())
    return digest.hexdigest()


def joined_key(*keys: str) -> str:
    """A digest of several keys, in their order."""
    return hashlib.sha256("\0".join(keys).encode()).hexdigest()
