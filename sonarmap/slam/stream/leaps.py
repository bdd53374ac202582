"""Scans of a dense stream that leap out of the way that their neighbors went."""

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import RigidTransform

# From so many times on what scans usually stray from the way between their neighbors, a scan leaps: in streams of 200
# to 400 scans none does, of 3,000 in a pool 25, of which 11 were off by more than 3 voxels, of 16 in all.
_LEAP = 6.0
_TO_SIGMA = 1.4826  # from a median of absolute numbers
_FASTER = 2.0  # times as fast as usual a vehicle goes there
_MOST_ROUNDS = 50  # of leaving out those that stray most from their neighbors


@dataclass(frozen=True, slots=True)
class Leaps:
    """What does not lie on the way.

    Attributes:
        scans: (n,) int, ascending.
        T: where the way between their neighbors has them, n poses.
        sigmas: (n, 6) standard deviations of that [rad, m].
        back: (n,) bool, whether the scan behind is where the vehicle would be without the leap: nothing goes so far and
            back from one scan to the next.
    """

    scans: np.ndarray
    T: RigidTransform
    sigmas: np.ndarray
    back: np.ndarray


def find_leaps(T: RigidTransform, times: np.ndarray, runs: np.ndarray, fixed: np.ndarray, floor: np.ndarray) -> Leaps:
    """The scans that stray far from a steady motion from the scan before to the one behind.

    Args:
        times: (N,) [s], ascending within a run.
        runs: (N,) equal for scans that follow one another in one map.
        fixed: (N,) bool, of scans that are right.
        floor: (6,) what scans may stray at least [rad, m].
    """
    left: np.ndarray = np.arange(len(times))
    if len(left) < 3:
        return Leaps(left[:0], T[left[:0]], np.zeros((0, 6)), np.zeros(0, bool))
    strayed = _strayed(T, times, left)
    inside = runs[left[:-2]] == runs[left[2:]]
    usual = np.maximum(_TO_SIGMA * np.median(np.abs(strayed[inside]), axis=0), floor) if inside.any() else floor
    step = float(np.median(np.diff(times)[np.diff(runs) == 0])) if inside.any() else 1.0
    for _ in range(_MOST_ROUNDS):
        far = np.linalg.norm(_strayed(T, times, left) / usual, axis=1)
        # a longer way between neighbors may be less steady
        far /= np.maximum((times[left[2:]] - times[left[:-2]]) / (2 * step), 1.0)
        far = np.pad(np.where((runs[left[:-2]] == runs[left[2:]]) & ~fixed[left[1:-1]], far, 0.0), 1)
        leaping = (far > _LEAP) & (far >= np.roll(far, 1)) & (far >= np.roll(far, -1))
        if not leaping.any() or len(left) - leaping.sum() < 3:
            break
        left = left[~leaping]
    gone = np.setdiff1d(np.arange(len(times)), left)
    behind = np.searchsorted(left, gone)
    before, after = left[behind - 1], left[behind]
    longer = np.maximum((times[after] - times[before]) / (2 * step), 1.0)
    ways, spans = _ways(T, before, after), times[after] - times[before]
    same = np.flatnonzero(np.diff(runs) == 0)
    speeds = np.median(_ways(T, same, same + 1) / np.maximum(np.diff(times)[same, None], 1e-9), axis=0)
    most = _FASTER * speeds * spans[:, None] + _LEAP * np.linalg.norm(usual.reshape(2, 3), axis=1)
    return Leaps(gone, _between(T, times, before, gone, after), longer[:, None] * usual, (ways <= most).all(axis=1))


def _ways(T: RigidTransform, i: np.ndarray, j: np.ndarray) -> np.ndarray:
    """(n, 2) how far poses are apart [rad, m]."""
    apart = T[i].inv() * T[j]
    return np.column_stack([apart.rotation.magnitude(), np.linalg.norm(apart.translation, axis=1)])


def _strayed(T: RigidTransform, times: np.ndarray, left: np.ndarray) -> np.ndarray:
    """(n - 2, 6) how far all but the first and the last of some scans are from the way between those beside them."""
    between = _between(T, times, left[:-2], left[1:-1], left[2:])
    return np.asarray((between.inv() * T[left[1:-1]]).as_exp_coords())


def _between(
    T: RigidTransform, times: np.ndarray, before: np.ndarray, own: np.ndarray, after: np.ndarray
) -> RigidTransform:
    """Where a steady motion from one scan to another passes at the time of a third."""
    share = (times[own] - times[before]) / np.maximum(times[after] - times[before], 1e-9)
    way = np.asarray((T[before].inv() * T[after]).as_exp_coords())
    return T[before] * RigidTransform.from_exp_coords(share[:, None] * way)
