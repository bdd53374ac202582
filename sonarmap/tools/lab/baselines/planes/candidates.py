"""Which planes of two scans may correspond, and the rotations and translations that many of them agree on."""

from dataclasses import dataclass
from functools import lru_cache
from itertools import combinations

import numpy as np
from scipy.ndimage import gaussian_filter, maximum_filter
from scipy.spatial.transform import Rotation

from sonarmap.tools.lab.baselines.planes.fit import Patches

# Areas of one surface seen from two places differ by up to this factor.
_AREA_RATIO = 6.0
# The same surface's normals differ by this besides their covariances [rad]; pairs less apart tell no rotation.
NORMAL_SLACK = float(np.deg2rad(1.5))
_LEAST_ANGLE = float(np.deg2rad(25.0))
_SIGMAS = 3.0
_BIN = float(np.deg2rad(3.0))
_RIM = 5
# So many pairs of planes, the largest of each direction, are asked for translations; normals within the angle are of
# one direction. Three fix a translation where they span this volume.
_ASKED_EACH, _ASKED = 16, 56
_ONE_DIRECTION = float(np.cos(np.deg2rad(30.0)))
_LEAST_VOLUME = 0.3
_MOST_EACH = 5


@dataclass(frozen=True, slots=True)
class PoseCandidates:
    """M pairs of planes that may be one."""

    # target, source: (M,) indices of patches
    target: np.ndarray
    source: np.ndarray
    area: np.ndarray  # (M,) the smaller area of both [m^2]
    angle_sigma: np.ndarray  # (M,) [rad] standard deviation of the angle between both normals, the slack included

    def __len__(self) -> int:
        return len(self.area)


def candidates(target: Patches, source: Patches, max_tilt: float) -> PoseCandidates:
    """All pairs of like size whose normals a rotation with roll and pitch up to max_tilt [rad] can bring together."""
    ratio = target.area[:, None] / source.area[None, :]
    # Rz Ry(pitch) Rx(roll) changes the angle with the vertical by no more than |pitch| + |roll|
    steep = np.arccos(np.clip(target.normal[:, 2], -1, 1))[:, None] - np.arccos(np.clip(source.normal[:, 2], -1, 1))
    alike = (ratio <= _AREA_RATIO) & (ratio >= 1 / _AREA_RATIO) & (np.abs(steep) <= 2 * max_tilt)
    i, j = np.nonzero(alike)
    area = np.minimum(target.area[i], source.area[j])
    order = np.argsort(-area, kind="stable")
    i, j, area = i[order], j[order], area[order]
    variance = _turn_variance(target)[i] + _turn_variance(source)[j] + NORMAL_SLACK**2
    return PoseCandidates(i, j, area, np.sqrt(variance))


def rotations(target: Patches, source: Patches, pairs: PoseCandidates, max_tilt: float, most: int) -> list[Rotation]:
    """The rotations R_target_source that most pairs of candidates agree on, best first.

    Any two candidates whose normals enclose the same angle in both scans give a rotation. Each votes for it with
    the smaller of their areas (its root: one large surface must not outvote many), in bins of yaw, pitch and roll.
    """
    a, b = _compatible(target, source, pairs)
    R = _triads(target, source, pairs, a, b)
    angles = R.as_euler("ZYX") if len(a) else np.empty((0, 3))
    level = (np.abs(angles[:, 1:]) <= max_tilt).all(axis=1)
    weight = np.sqrt(np.minimum(pairs.area[a], pairs.area[b]))[level]
    half = int(np.ceil(max_tilt / _BIN)) + 1
    turns = round(2 * np.pi / _BIN)
    shape = (turns, 2 * half + 1, 2 * half + 1)
    bins = np.rint(angles[level] / _BIN).astype(np.int64) + np.array([0, half, half])
    bins[:, 0] %= turns
    flat = np.bincount(np.ravel_multi_index(tuple(bins.T), shape), weight, minlength=int(np.prod(shape)))
    around = np.pad(flat.reshape(shape), ((_RIM, _RIM), (0, 0), (0, 0)), mode="wrap")  # a full turn of yaw
    smooth = gaussian_filter(around, 0.8, mode="constant")
    votes = smooth[_RIM:-_RIM]
    peaks = (votes == maximum_filter(smooth, 3, mode="constant")[_RIM:-_RIM]) & (votes > 0)
    peaks_at = np.argwhere(peaks)
    best = peaks_at[np.argsort(-votes[peaks], kind="stable")[:most]]
    return [Rotation.from_euler("ZYX", (place - (0, half, half)) * _BIN) for place in best]


def consistent(target: Patches, source: Patches, pairs: PoseCandidates, R: Rotation, slack: float) -> np.ndarray:
    """(n,) the candidates whose normals R brings within 3 sigma and `slack` [rad] of each other, largest first."""
    cosine = np.einsum("mi,mi->m", target.normal[pairs.target], R.apply(source.normal[pairs.source]))
    return np.flatnonzero(np.arccos(np.clip(cosine, -1, 1)) <= _SIGMAS * pairs.angle_sigma + slack)


def translations(
    target: Patches,
    source: Patches,
    pairs: PoseCandidates,
    chosen: np.ndarray,
    R: Rotation,
    bounds: tuple[float, float],
) -> list[tuple[np.ndarray, float]]:
    """The translations (3,) [m] that most of the chosen candidates agree on under R, with their scores, best first.

    Any three of the largest whose normals span space give one, or any two where no three do. Those count for it that
    it brings together, in distance and, since a surface seen twice is seen in part at the same place, sideways.

    Args:
        bounds: the longest translation and the distance [m] by which two planes may miss each other.
    """
    farthest, near = bounds
    chosen = chosen[_of_each_direction(target.normal[pairs.target[chosen]])]
    i, j = pairs.target[chosen], pairs.source[chosen]
    normal = target.normal[i]
    apart = target.distance[i] - source.distance[j]
    t = _of_triples(normal, apart, i, j)
    if not len(t):
        t = _of_couples(normal, apart, target.middle[i] - R.apply(source.middle[j]))
    t = t[np.linalg.norm(t, axis=1) <= farthest]
    if not len(t):
        return []
    reach = near + _SIGMAS * np.minimum(np.sqrt(_shift_variance(target)[i] + _shift_variance(source)[j]), near)
    off = np.einsum("ki,mi->km", t, normal) - np.einsum(
        "mi,mi->m", normal, target.middle[i] - R.apply(source.middle[j])
    )
    meets = np.abs(off) <= reach + np.tan(NORMAL_SLACK) * _radius(target)[i]
    sideways = t[:, None, :] + (R.apply(source.middle[j]) - target.middle[i])[None]
    meets &= np.linalg.norm(sideways, axis=2) <= _radius(target)[i] + _radius(source)[j]
    score = meets @ np.sqrt(pairs.area[chosen])
    return _distinct(t, score, 2 * near, _MOST_EACH)


def _turn_variance(patches: Patches) -> np.ndarray:
    return np.trace(patches.covariance[:, :3, :3], axis1=1, axis2=2) / 2


def _shift_variance(patches: Patches) -> np.ndarray:
    """(K,) [m^2] of each plane along its normal at its patch's middle."""
    row = np.concatenate([patches.middle, -np.ones((len(patches), 1))], axis=1)  # n . middle - d
    return np.einsum("ki,kij,kj->k", row, patches.covariance, row)


def _radius(patches: Patches) -> np.ndarray:
    """(K,) [m] how far each patch reaches about its middle: two standard deviations of its longest extent."""
    return 2 * np.sqrt(np.linalg.eigvalsh(patches.spread)[:, 2])


def _compatible(target: Patches, source: Patches, pairs: PoseCandidates) -> tuple[np.ndarray, np.ndarray]:
    """The pairs (a, b) of candidates, a < b, of which either scan's normals enclose the same angle."""
    angles = [np.arccos(np.clip(patches.normal @ patches.normal.T, -1, 1)) for patches in (target, source)]
    i, j = pairs.target, pairs.source
    there, here = angles[0][np.ix_(i, i)], angles[1][np.ix_(j, j)]
    spread = np.hypot(pairs.angle_sigma[:, None], pairs.angle_sigma[None, :])
    same = np.abs(there - here) <= np.minimum(_SIGMAS * spread, np.deg2rad(8.0))
    spans = (np.minimum(there, np.pi - there) >= _LEAST_ANGLE) & (np.minimum(here, np.pi - here) >= _LEAST_ANGLE)
    a, b = np.nonzero(np.triu(same & spans, 1))
    return a, b


def _triads(target: Patches, source: Patches, pairs: PoseCandidates, a: np.ndarray, b: np.ndarray) -> Rotation:
    """The rotations (n) that two pairs of normals give: the same frame built on either side."""

    def frames(normal: np.ndarray, first: np.ndarray, second: np.ndarray) -> np.ndarray:
        u = normal[first] + normal[second]
        v = np.cross(normal[first], normal[second])
        u /= np.linalg.norm(u, axis=1, keepdims=True)
        v /= np.linalg.norm(v, axis=1, keepdims=True)
        return np.stack([u, v, np.cross(u, v)], axis=2)

    if not len(a):
        return Rotation.identity(0)
    there = frames(target.normal, pairs.target[a], pairs.target[b])
    here = frames(source.normal, pairs.source[a], pairs.source[b])
    return Rotation.from_matrix(there @ np.swapaxes(here, 1, 2))


def _of_each_direction(normal: np.ndarray) -> np.ndarray:
    """Indices (k,) into normals (n, 3): the first few of each direction, so that none crowds out the others."""
    leaders: list[np.ndarray] = []
    count: list[int] = []
    chosen: list[int] = []
    for number, one in enumerate(normal):
        along = np.abs(np.array(leaders).reshape(-1, 3) @ one)
        if not len(along) or along.max() < _ONE_DIRECTION:
            leaders.append(one)
            count.append(0)
            along = np.append(along, 1.0)
        direction = int(along.argmax())
        if count[direction] < _ASKED_EACH and len(chosen) < _ASKED:
            count[direction] += 1
            chosen.append(number)
    return np.array(chosen, np.int64)


def _of_triples(normal: np.ndarray, apart: np.ndarray, i: np.ndarray, j: np.ndarray) -> np.ndarray:
    """(k, 3) [m] where three planes n . t = apart meet, of all triples (of planes of their own) that span space."""
    a, b, c = _triples(len(normal)).T
    own = (i[a] != i[b]) & (i[b] != i[c]) & (i[a] != i[c]) & (j[a] != j[b]) & (j[b] != j[c]) & (j[a] != j[c])
    a, b, c = a[own], b[own], c[own]
    bc, ca, ab = (np.cross(normal[x], normal[y]) for x, y in ((b, c), (c, a), (a, b)))
    volume = np.einsum("ki,ki->k", normal[a], bc)
    spans = np.abs(volume) >= _LEAST_VOLUME
    met = apart[a][:, None] * bc + apart[b][:, None] * ca + apart[c][:, None] * ab
    return met[spans] / volume[spans, None]


def _of_couples(normal: np.ndarray, apart: np.ndarray, between: np.ndarray) -> np.ndarray:
    """(k, 3) [m] of all couples that span a plane; across it, where none tells, their middles come together."""
    a, b = np.triu_indices(len(normal), 1)
    third = np.cross(normal[a], normal[b])
    size = np.linalg.norm(third, axis=1)
    spans = size >= _LEAST_VOLUME
    a, b, third = a[spans], b[spans], third[spans] / size[spans, None]
    rows = np.stack([normal[a], normal[b], third], axis=1)
    middles = np.einsum("ki,ki->k", third, between[a] + between[b]) / 2
    return np.linalg.solve(rows, np.stack([apart[a], apart[b], middles], axis=1)[..., None])[..., 0]


@lru_cache(maxsize=_ASKED + 1)
def _triples(count: int) -> np.ndarray:
    return np.array(list(combinations(range(count), 3)), dtype=np.int64).reshape(-1, 3)


def _distinct(t: np.ndarray, score: np.ndarray, apart: float, most: int) -> list[tuple[np.ndarray, float]]:
    """The highest scored t (k, 3) and their scores, no two nearer than `apart` [m]."""
    order = np.argsort(-score, kind="stable")
    t, score = t[order], score[order]
    distinct: list[tuple[np.ndarray, float]] = []
    while len(t) and len(distinct) < most:
        distinct.append((t[0], float(score[0])))
        other = np.linalg.norm(t - t[0], axis=1) > apart
        t, score = t[other], score[other]
    return distinct
