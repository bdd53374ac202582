"""Key scans of a dense stream: as few as tell how the vehicle went, found while it is read."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sonarmap.kernels.errors import InputError
from sonarmap.slam.execute.runner import PairRunner
from sonarmap.slam.pair import Candidate, RegisteredPair
from sonarmap.spectral.result import Registration

_MIN_SCANS = 40  # of a stream: a shorter survey is registered scan by scan
_PROBES = 7  # pairs of consecutive scans, evenly along a survey, that show whether it is a stream
_MIN_ACCEPTED_PROBES = 2
# Consecutive scans of a stream are less far apart.
_DENSE_SHIFT = 2.0  # [voxels]
_DENSE_TURN = float(np.radians(4.0))  # [rad]
# The next key scan is at one of these.
_KEY_SHIFT = 8.0  # [voxels]
_KEY_TURN = float(np.radians(15.0))  # [rad]
_KEY_OVERLAP = 0.7
_AIM = 0.8  # of these distances, the share that a stride aims at
_LONGEST_STRIDE = 256  # [scans]; a stride at most doubles
# Most pairs that are registered at a time where there are as many workers; it is ever less likely that a pair further
# on is one of those that the search asks for.
_AT_A_TIME = 4


@dataclass(frozen=True, slots=True)
class KeySettings:
    """How key scans are chosen.

    Attributes:
        step: how far apart they are [m]; None for what suits the voxel and the overlap, where the stream is dense.
    """

    step: float | None = None

    def __post_init__(self) -> None:
        if self.step is not None and not (np.isfinite(self.step) and self.step > 0):
            raise InputError(f"`key_step` is {self.step} m; wanted more than 0")


def choose_keys(
    runner: PairRunner, surveys: np.ndarray, voxel: float, settings: KeySettings
) -> tuple[list[int], list[RegisteredPair]]:
    """The key scans, ascending, and pairs of consecutive ones that were registered; all scans if none can be spared.

    From each key scan a scan further on is registered to it. How far the vehicle went, how much it turned and how much
    both scans share says how far on the next one is sought; where a registration is refused, half as far. One that is
    refused only for a direction that the scans leave open, as along a wall, would be so at half the way as well: there
    strides are as they were before. `surveys` are (N,), each scan's number of its survey; the voxel is theirs [m].
    """
    keys: list[int] = []
    pairs: list[RegisteredPair] = []
    for number in np.unique(surveys).tolist():
        own: list[int] = np.flatnonzero(surveys == number).tolist()
        probes = [] if settings.step is not None else _probes(runner, own)
        if settings.step is not None or _is_dense(probes, voxel):
            own, probes = _gallop(runner, own, voxel, settings)
        keys += own
        pairs += probes
    return keys, pairs


def _probes(runner: PairRunner, scans: Sequence[int]) -> list[RegisteredPair]:
    """Some consecutive scans, registered; none of a survey that is short anyway."""
    if len(scans) < _MIN_SCANS:
        return []
    places: list[int] = np.unique(np.linspace(0, len(scans) - 2, _PROBES).astype(int)).tolist()
    return runner.register([Candidate(scans[k], scans[k + 1], "sequential") for k in places])


def _is_dense(probes: Sequence[RegisteredPair], voxel: float) -> bool:
    """Whether most of the vehicle's steps are too small to tell much; refused pairs do not tell."""
    near = [
        _motion(pair.registration, voxel) <= 1 for pair in probes if pair.accepted and pair.registration is not None
    ]
    return len(near) >= _MIN_ACCEPTED_PROBES and 2 * sum(near) > len(near)


def _motion(registration: Registration, voxel: float) -> float:
    """The motion as a share of what makes a stream dense."""
    T = registration.T_target_source
    way, turn = float(np.linalg.norm(T.translation)), float(T.rotation.magnitude())
    return max(way / (_DENSE_SHIFT * voxel), turn / _DENSE_TURN)


def _gallop(
    runner: PairRunner, scans: Sequence[int], voxel: float, settings: KeySettings
) -> tuple[list[int], list[RegisteredPair]]:
    keys, pairs, at, stride, usual = [scans[0]], list[RegisteredPair](), 0, 1, 1
    registered: dict[tuple[int, int], RegisteredPair] = {}
    while at < len(scans) - 1:
        stride = min(stride, len(scans) - 1 - at)
        if (scans[at], scans[at + stride]) not in registered:
            ahead = _even_strides(scans, at, stride, min(runner.workers, _AT_A_TIME))
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
            stride = usual = min(max(1, int(stride * min(2.0, _AIM / share))), _LONGEST_STRIDE)
        else:
            stride = min(2 * stride, usual) if pair.placed else 1
    return keys, pairs


def _even_strides(scans: Sequence[int], at: int, stride: int, count: int) -> list[Candidate]:
    """The next pair and what `count` - 1 would follow it if the strides stayed as they are: work for other workers,
    which changes no result, as the search takes only what it asks for."""
    last = len(scans) - 1
    starts = range(at, last, stride)[:count]
    return [Candidate(scans[k], scans[min(k + stride, last)], "sequential") for k in starts]


def key_share(registration: Registration, voxel: float, settings: KeySettings) -> float:
    """How far two key scans are apart, as a share of how far they may be."""
    T = registration.T_target_source
    way, turn = float(np.linalg.norm(T.translation)), float(T.rotation.magnitude())
    lost = (1 - registration.overlap) / (1 - _KEY_OVERLAP)
    if settings.step is not None:
        return max(way / settings.step, turn / _KEY_TURN if way < settings.step / 10 else 0.0)
    return max(way / (_KEY_SHIFT * voxel), turn / _KEY_TURN, lost)
