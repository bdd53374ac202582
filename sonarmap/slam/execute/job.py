"""Jobs of workers: scans with the digests of their content, and pairs of them. Scans with the same content give the
same results, whatever their names."""

import hashlib
from dataclasses import dataclass

import numpy as np

from sonarmap.spectral.expected import ExpectedPose
from sonarmap.spectral.scan import Scan


@dataclass(frozen=True, slots=True)
class KeyedScan:
    """A scan with the digest of its content."""

    scan: Scan
    content: str  # `content_key` of the scan

    @classmethod
    def of(cls, scan: Scan) -> "KeyedScan":
        return cls(scan, content_key(scan))

    @property
    def key(self) -> tuple[str, str]:
        """What decides a scan's results; messages contain the name."""
        return self.content, self.scan.name


@dataclass(frozen=True, slots=True)
class PairJob:
    """Two scans to register, source to target, and their relative pose if the motion predicts one."""

    target: KeyedScan
    source: KeyedScan
    expected: ExpectedPose | None = None


Job = PairJob | KeyedScan  # a pair to register, or a scan whose signature is wanted


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


def job_key(job: Job, method: str) -> str:
    """The journal's key of all that determines a job's result, including a pair's expected pose."""
    kind, expected = ("signature", None) if isinstance(job, KeyedScan) else ("pair", job.expected)
    if expected is not None:
        T = expected.T_target_source
        numbers = np.concatenate([T.rotation.as_quat(), T.translation, expected.covariance.ravel()])
        kind = f"pair {'measured' if expected.by_instruments else 'expected'} at {numbers.tolist()}"
    return hashlib.sha256("\0".join([kind, method, *(scan.content for scan in _scans_of(job))]).encode()).hexdigest()


def job_label(job: Job) -> str:
    """The names of a job's scans, for people; bytes of file names that are no text are escaped."""
    label = " - ".join(scan.scan.name for scan in _scans_of(job))
    return label.encode("utf-8", "backslashreplace").decode()


def _scans_of(job: Job) -> tuple[KeyedScan, ...]:
    return (job,) if isinstance(job, KeyedScan) else (job.target, job.source)
