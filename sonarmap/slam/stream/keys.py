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
_MIN_ACCEPTED_PROBES = 2
_DENSE_SHIFT = 2.0  # largest between consecutive scans of a stream [voxels]
_DENSE_TURN = float(np.radians(4.0))  # largest between consecutive scans of a stream [rad]
_KEY_SHIFT = 8.0  # largest between key scans [voxels]
_KEY_TURN = float(np.radians(15.0))  # largest between key scans [rad]
_KEY_OVERLAP = 0.7  # smallest between key scans
_AIM = 0.8  # share of these distances that a stride aims at
_MAX_STRIDE = 256  # [scans]; a stride at most doubles
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
    stride; after a refused registration the stride is halved. It is kept if the registration is refused only for
    an unconstrained direction, as along a wall, since half the stride would not constrain it either. `surveys` (N,)
    holds each scan's survey number; `voxel` is in meters.
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
    """Whether most accepted probes are closer than consecutive scans of a stream; refused ones do not count."""
    near = [
        _motion(pair.registration, voxel) <= 1 for pair in probes if pair.accepted and pair.registration is not None
    ]
    return len(near) >= _MIN_ACCEPTED_PROBES and 2 * sum(near) > len(near)


def _motion(registration: Registration, voxel: float) -> float:
    """The motion as a share of the largest one between consecutive scans of a stream."""
    T = registration.T_target_source
    shift, turn = float(np.linalg.norm(T.translation)), float(T.rotation.magnitude())
    return max(shift / (_DENSE_SHIFT * voxel), turn / _DENSE_TURN)


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
        if not pair.accepted and not pair.placed and stride > 1:
            stride = max(1, stride // 2)
            continue
        pairs.append(pair)
        at += stride
        keys.append(scans[at])
        if pair.accepted and pair.registration is not None:
            share = max(key_share(pair.registration, voxel, settings), 1e-3)
            stride = usual = min(max(1, int(stride * min(2.0, _AIM / share))), _MAX_STRIDE)
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
    T = registration.T_target_source
    shift, turn = float(np.linalg.norm(T.translation)), float(T.rotation.magnitude())
    lost = (1 - registration.overlap) / (1 - _KEY_OVERLAP)
    if settings.step is not None:
        return max(shift / settings.step, turn / _KEY_TURN if shift < settings.step / 10 else 0.0)
    return max(shift / (_KEY_SHIFT * voxel), turn / _KEY_TURN, lost)
