"""Key scans of a dense stream: few scans that overlap enough to be registered to one another."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sonarmap.kernels.errors import InputError
from sonarmap.slam.execute.runner import PairRunner
from sonarmap.slam.pair import Candidate, RegisteredPair
from sonarmap.spectral.result import Registration

_MIN_SCANS = 40  # of a stream; a shorter survey is registered scan by scan
_PROBES = 7  # pairs of consecutive scans, evenly along a survey, that show whether it is a stream
_KEY_SHIFT = 8.0  # largest between key scans [voxels]
_KEY_TURN = float(np.radians(15.0))  # largest between key scans [rad]
_KEY_OVERLAP = 0.7  # smallest between key scans
AIM = 0.8  # share of these distances that a stride aims at
_MAX_STRIDE = 256  # [scans]
_MAX_AHEAD = 4  # pairs registered at a time, if there are as many workers; pairs further ahead are rarely needed


@dataclass(frozen=True, slots=True)
class KeySettings:
    """How key scans are chosen.

    Attributes:
        step: distance between key scans [m]; None lets the voxel and the overlap decide, in dense streams only.
    """

    step: float | None = None

    def __post_init__(self) -> None:
        if self.step is not None and not (np.isfinite(self.step) and self.step > 0):
            raise InputError(f"`key_step` is {self.step} m; wanted more than 0")


def choose_keys(
    runner: PairRunner, surveys: np.ndarray, voxel: float, settings: KeySettings
) -> tuple[list[int], list[RegisteredPair]]:
    """The key scans, ascending (all scans of a survey that is not dense), and the registered pairs of consecutive ones.

    A scan some stride ahead is registered to the last key scan. Their shift, turn and overlap determine the next
    stride; after a refused registration, or one that leads too far, it is tried again with a shorter stride. It is kept
    if the registration is refused only for an unconstrained direction, as along a wall, since a shorter stride would
    not constrain it either. `surveys` (N,) holds each scan's survey number; `voxel` is in meters.
    """
    keys: list[int] = []
    pairs: list[RegisteredPair] = []
    for number in np.unique(surveys).tolist():
        scans: list[int] = np.flatnonzero(surveys == number).tolist()
        probes = [] if settings.step is not None else _probes(runner, scans)
        if settings.step is not None or _is_dense(probes, voxel):
            scans, probes = _gallop(runner, scans, voxel, settings)
        keys += scans
        pairs += probes
    return keys, pairs


def _probes(runner: PairRunner, scans: Sequence[int]) -> list[RegisteredPair]:
    """Registered pairs of consecutive scans, evenly along a survey; none if the survey is short."""
    if len(scans) < _MIN_SCANS:
        return []
    firsts: list[int] = np.unique(np.linspace(0, len(scans) - 2, _PROBES).astype(int)).tolist()
    return runner.register([Candidate(scans[k], scans[k + 1], "sequential") for k in firsts])


def _is_dense(probes: Sequence[RegisteredPair], voxel: float) -> bool:
    """Whether two scans of three would be between key scans, by most accepted probes; refused ones do not count."""
    accepted = [pair.registration for pair in probes if pair.accepted and pair.registration is not None]
    near = [3 * _motion_share(registration, _KEY_SHIFT * voxel) <= AIM for registration in accepted]
    return sum(near) > max(1, len(near) / 2)


def _motion_share(registration: Registration, shift: float) -> float:
    """The motion between two scans as a share of the largest one between key scans, a shift of `shift` [m]."""
    T = registration.T_target_source
    return max(float(np.linalg.norm(T.translation)) / shift, float(T.rotation.magnitude()) / _KEY_TURN)


def _gallop(
    runner: PairRunner, scans: Sequence[int], voxel: float, settings: KeySettings
) -> tuple[list[int], list[RegisteredPair]]:
    keys, pairs, at, stride, usual = [scans[0]], list[RegisteredPair](), 0, 1, 1
    registered: dict[tuple[int, int], RegisteredPair] = {}
    while at < len(scans) - 1:
        stride = min(stride, len(scans) - 1 - at)
        if (scans[at], scans[at + stride]) not in registered:
            ahead = _even_strides(scans, at, stride, min(runner.workers, _MAX_AHEAD))
            new = [pair for pair in ahead if pair.scans not in registered]
            registered |= {pair.scans: pair for pair in runner.register(new)}
        pair = registered[scans[at], scans[at + stride]]
        share = 2 * AIM  # of a refused registration, which halves the stride
        if pair.accepted and pair.registration is not None:
            share = key_share(pair.registration, voxel, settings)
        following = max(1, int(stride * min(2.0, AIM / max(share, 1e-3))))
        if stride > 1 and share > 1 and (pair.accepted or not pair.placed):
            stride = following
            continue
        pairs.append(pair)
        at += stride
        keys.append(scans[at])
        if pair.accepted:
            stride = usual = min(following, _MAX_STRIDE)
        else:
            stride = min(2 * stride, usual) if pair.placed else 1
    return keys, pairs


def _even_strides(scans: Sequence[int], at: int, stride: int, count: int) -> list[Candidate]:
    """The next pair and the `count` - 1 after it with the same stride: work for idle workers. It changes no result, as
    the search uses only the pairs that it comes to."""
    last = len(scans) - 1
    starts = range(at, last, stride)[:count]
    return [Candidate(scans[k], scans[min(k + stride, last)], "sequential") for k in starts]


def key_share(registration: Registration, voxel: float, settings: KeySettings) -> float:
    """The motion between two scans as a share of the largest one between key scans; 1 or more is too far."""
    if settings.step is None:
        lost = (1 - registration.overlap) / (1 - _KEY_OVERLAP)
        return max(_motion_share(registration, _KEY_SHIFT * voxel), lost)
    shift = float(np.linalg.norm(registration.T_target_source.translation)) / settings.step
    return shift if shift >= 0.1 else _motion_share(registration, settings.step)
