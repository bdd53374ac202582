"""The largest set of planes that one transform brings together: minimally uncertain maximal consensus (MUMC).

Pathak, Birk, Vaskevicius, Poppinga: Fast registration based on noisy planes with unknown correspondences for 3D
mapping. IEEE Transactions on Robotics 26(3), 2010, DOI 10.1109/TRO.2010.2042989.
"""

from collections.abc import Iterable
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import combinations

import numpy as np
from scipy.ndimage import gaussian_filter, maximum_filter
from scipy.spatial.transform import RigidTransform, Rotation

from sonarmap.tools.lab.baselines.planes.fit import Patches
from sonarmap.tools.lab.baselines.planes.pose import PlanePose, Slack, closed_form, compare, refine, settle

# Areas of one surface seen from two places differ by up to this factor.
_AREA_RATIO = 6.0
# The same surface's normals differ by this besides their covariances [rad]; pairs less apart tell no rotation.
_NORMAL_SLACK = float(np.deg2rad(1.5))
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
# chi-squared of three degrees of freedom, 99.9 %
_GATE = 16.27
_ROUNDS = 4
# What the planes of one surface differ by when other parts of it are seen [voxels].
_SHIFT_SLACK = 0.35
# Patches meet whose middles are no farther apart than so many standard deviations of both extents.
_REACH = 1.3
# Of the sets with nearly as many planes as the largest the least uncertain is preferred.
_AS_MANY = 0.9
_MOST_ROTATIONS, _MOST_STARTS, _MOST_SINGLE = 40, 100, 30


@dataclass(frozen=True, slots=True)
class Consensus:
    """Planes that correspond, and the transform that they give."""

    pose: PlanePose  # the transform and its covariance
    # target, source: (M,) which patches correspond, each in one pair at most
    target: np.ndarray
    source: np.ndarray
    area: float  # of the pairs, each the smaller of both patches' [m^2]

    def __len__(self) -> int:
        return len(self.target)

    @property
    def volume(self) -> float:
        """The logarithm of the determinant of the transform's covariance."""
        return float(np.linalg.slogdet(self.pose.covariance)[1])


class Matching:
    """The planes of two scans, and the search for what corresponds.

    Args:
        target, source: K >= 1 patches each.
        voxel: edge of a voxel [m], what the planes were grown with.
        max_tilt: largest roll and pitch [rad].
        farthest: longest translation [m]; directions that the planes leave open are as uncertain.
    """

    def __init__(self, target: Patches, source: Patches, voxel: float, max_tilt: float, farthest: float) -> None:
        self.target, self.source = target, source
        self.voxel, self.max_tilt, self.farthest = voxel, max_tilt, farthest
        self._slack = Slack(_NORMAL_SLACK, _SHIFT_SLACK * voxel)
        self._seen: set[bytes] = set()
        # candidates: all pairs (i, j) of like size whose normals such a rotation can bring together, largest first;
        # Rz Ry(pitch) Rx(roll) changes the angle with the vertical by no more than |pitch| + |roll|
        ratio = target.area[:, None] / source.area[None, :]
        tilt, other = (np.arccos(np.clip(patches.normal[:, 2], -1, 1)) for patches in (target, source))
        alike = (ratio <= _AREA_RATIO) & (ratio >= 1 / _AREA_RATIO) & (np.abs(tilt[:, None] - other) <= 2 * max_tilt)
        i, j = np.nonzero(alike)
        area = np.minimum(target.area[i], source.area[j])
        order = np.argsort(-area, kind="stable")
        self._i, self._j, self._area = i[order], j[order], area[order]
        variance = [np.trace(patches.covariance[:, :3, :3], axis1=1, axis2=2) / 2 for patches in (target, source)]
        # [rad] of the angle between both normals
        self._sigma = np.sqrt(variance[0][self._i] + variance[1][self._j] + _NORMAL_SLACK**2)

    def find(self) -> list[Consensus]:
        """Sets of planes that agree on a transform, best first; empty where not even two do.

        As in the paper sets grow from pairs of candidates that give a rotation, by what is consistent with it, then
        by the translation; of the largest sets that of the least uncertain transform wins. Unlike there the pairs'
        rotations are pooled first, so that a set is grown once for all pairs that would grow it. Where all planes are
        parallel they grow from the smallest rotation for each of the largest candidates.
        """
        singles = (closed_form(*self._planes(np.array([k]))) for k in range(min(_MOST_SINGLE, len(self._area))))
        sets = self._grown(self._starts()) or self._grown(singles)
        if sets:
            best = min((each for each in sets if len(each) >= _AS_MANY * len(sets[0])), key=lambda each: each.volume)
            planes = self.target.take(best.target), self.source.take(best.source)
            pose = settle(*planes, best.pose.T_target_source, self.farthest, self._slack)
            sets = [replace(best, pose=pose), *(each for each in sets if each is not best)]
        return sets

    def _grown(self, starts: Iterable[RigidTransform]) -> list[Consensus]:
        """What grows from the starts, most planes first."""
        grown = [each for start in starts if (each := self._grow(start)) is not None]
        return sorted(grown, key=lambda each: (-len(each), each.volume))

    def _starts(self) -> list[RigidTransform]:
        """Transforms that pairs and triples of planes give, those on which most agree."""
        scored = [
            (score, RigidTransform.from_components(t, R))
            for R in self._rotations()
            for t, score in self._translations(R)
        ]
        return [start for _, start in sorted(scored, key=lambda start: -start[0])[:_MOST_STARTS]]

    def _grow(self, start: RigidTransform) -> Consensus | None:
        """The planes that a transform brings together, and the transform that these give, in turn.

        None where they are fewer than two, or a set that was grown before.
        """
        T, slack = start, Slack(2 * _NORMAL_SLACK, self.voxel)
        pose, index = None, np.empty(0, np.int64)
        own: set[bytes] = set()
        for _ in range(_ROUNDS):
            matches = self._matches(T, slack)
            key = matches.tobytes()
            if key in own:  # it stays, or goes round in a circle
                break
            if len(matches) < 2 or key in self._seen:
                return None
            own.add(key)
            index, planes = matches, self._planes(matches)
            pose = refine(*planes, closed_form(*planes) if pose is None else T, self.farthest, self._slack)
            T, slack = pose.T_target_source, self._slack
        self._seen |= own
        if pose is None:
            return None
        return Consensus(pose, self._i[index], self._j[index], float(self._area[index].sum()))

    def _planes(self, index: np.ndarray) -> tuple[Patches, Patches]:
        return self.target.take(self._i[index]), self.source.take(self._j[index])

    def _matches(self, T: RigidTransform, slack: Slack) -> np.ndarray:
        """The candidates (n,) that T brings together: one plane, patches that meet, each once, largest first."""
        index = np.flatnonzero(_meet(self.target, self.source, T)[self._i, self._j])
        index = index[compare(*self._planes(index), T, slack) <= _GATE]
        mine: set[int] = set()
        others: set[int] = set()
        kept = []
        for candidate, i, j in zip(index.tolist(), self._i[index].tolist(), self._j[index].tolist(), strict=True):
            if i not in mine and j not in others:
                kept.append(candidate)
                mine.add(i)
                others.add(j)
        return np.array(kept, np.int64)

    def _rotations(self) -> list[Rotation]:
        """The rotations R_target_source that most pairs of candidates agree on, best first.

        Any two candidates whose normals enclose the same angle in both scans give a rotation. Each votes for it with
        the smaller of their areas (its root: one large surface must not outvote many), in bins of yaw, pitch and roll.
        """
        a, b = self._compatible()
        if not len(a):
            return []
        there = _frames(self.target.normal, self._i[a], self._i[b])
        here = _frames(self.source.normal, self._j[a], self._j[b])
        angles = Rotation.from_matrix(there @ np.swapaxes(here, 1, 2)).as_euler("ZYX")
        level = (np.abs(angles[:, 1:]) <= self.max_tilt).all(axis=1)
        weight = np.sqrt(np.minimum(self._area[a], self._area[b]))[level]
        half = int(np.ceil(self.max_tilt / _BIN)) + 1
        turns = round(2 * np.pi / _BIN)
        shape = (turns, 2 * half + 1, 2 * half + 1)
        bins = np.rint(angles[level] / _BIN).astype(np.int64) + np.array([0, half, half])
        bins[:, 0] %= turns
        flat = np.bincount(np.ravel_multi_index(tuple(bins.T), shape), weight, minlength=int(np.prod(shape)))
        around = np.pad(flat.reshape(shape), ((_RIM, _RIM), (0, 0), (0, 0)), mode="wrap")  # a full turn of yaw
        smooth = gaussian_filter(around, 0.8, mode="constant")
        votes = smooth[_RIM:-_RIM]
        peaks = (votes == maximum_filter(smooth, 3, mode="constant")[_RIM:-_RIM]) & (votes > 0)
        best = np.argwhere(peaks)[np.argsort(-votes[peaks], kind="stable")[:_MOST_ROTATIONS]]
        return [Rotation.from_euler("ZYX", (place - (0, half, half)) * _BIN) for place in best]

    def _compatible(self) -> tuple[np.ndarray, np.ndarray]:
        """The pairs (a, b) of candidates, a < b, of which either scan's normals enclose the same angle."""
        there, here = (
            np.arccos(np.clip(patches.normal @ patches.normal.T, -1, 1))[np.ix_(index, index)]
            for patches, index in ((self.target, self._i), (self.source, self._j))
        )
        spread = np.hypot(self._sigma[:, None], self._sigma[None, :])
        same = np.abs(there - here) <= np.minimum(_SIGMAS * spread, np.deg2rad(8.0))
        spans = (np.minimum(there, np.pi - there) >= _LEAST_ANGLE) & (np.minimum(here, np.pi - here) >= _LEAST_ANGLE)
        a, b = np.nonzero(np.triu(same & spans, 1))
        return a, b

    def _translations(self, R: Rotation) -> list[tuple[np.ndarray, float]]:
        """The translations (3,) [m] that most candidates consistent with R agree on, with their scores, best first.

        Any three of the largest whose normals span space give one, or any two where no three do. Those count
        for it that it brings together, in distance and, since a surface seen twice is partly seen at the same place,
        sideways.
        """
        target, source = self.target, self.source
        cosine = np.einsum("mi,mi->m", target.normal[self._i], R.apply(source.normal[self._j]))
        turned = np.arccos(np.clip(cosine, -1, 1)) <= _SIGMAS * self._sigma + _NORMAL_SLACK
        chosen = np.flatnonzero(turned)
        chosen = chosen[_of_each_direction(target.normal[self._i[chosen]])]
        i, j = self._i[chosen], self._j[chosen]
        normal, between = target.normal[i], target.middle[i] - R.apply(source.middle[j])
        apart = target.distance[i] - source.distance[j]
        t = _of_triples(normal, apart, i, j)
        if not len(t):
            t = _of_couples(normal, apart, between)
        t = t[np.linalg.norm(t, axis=1) <= self.farthest]
        sigma = np.sqrt(_shift_variance(target)[i] + _shift_variance(source)[j])
        reach = self.voxel + _SIGMAS * np.minimum(sigma, self.voxel)
        off = np.einsum("ki,mi->km", t, normal) - np.einsum("mi,mi->m", normal, between)
        # how far patches reach about their middles: two standard deviations of the longest extent [m]
        radius, other = (2 * np.sqrt(np.linalg.eigvalsh(patches.spread)[:, 2]) for patches in (target, source))
        meets = np.abs(off) <= reach + np.tan(_NORMAL_SLACK) * radius[i]
        meets &= np.linalg.norm(t[:, None, :] - between[None], axis=2) <= radius[i] + other[j]
        return _distinct(t, meets @ np.sqrt(self._area[chosen]), 2 * self.voxel)


def _frames(normal: np.ndarray, first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """(n, 3, 3) the frame that two normals give, the same on either side."""
    u = normal[first] + normal[second]
    v = np.cross(normal[first], normal[second])
    u /= np.linalg.norm(u, axis=1, keepdims=True)
    v /= np.linalg.norm(v, axis=1, keepdims=True)
    return np.stack([u, v, np.cross(u, v)], axis=2)


def _meet(target: Patches, source: Patches, T: RigidTransform) -> np.ndarray:
    """(Kt, Ks) bool: whether patches lie at one place, by their extents along the line between their middles."""
    R = T.rotation.as_matrix()
    line = T.apply(source.middle)[None] - target.middle[:, None]
    length = np.linalg.norm(line, axis=2)
    way = line / np.maximum(length, 1e-9)[..., None]
    reach = np.sqrt(np.einsum("tsi,tij,tsj->ts", way, target.spread, way))
    reach = reach + np.sqrt(np.einsum("tsi,sij,tsj->ts", way, R @ source.spread @ R.T, way))
    return length <= _REACH * reach + 1e-9


def _shift_variance(patches: Patches) -> np.ndarray:
    """(K,) [m^2] of each plane along its normal at its patch's middle."""
    row = np.concatenate([patches.middle, -np.ones((len(patches), 1))], axis=1)  # n . middle - d
    return np.einsum("ki,kij,kj->k", row, patches.covariance, row)


def _of_each_direction(normal: np.ndarray) -> np.ndarray:
    """Indices (k,) into normals (n, 3): the first few of each direction, so that none crowds out the others."""
    leaders, count, chosen = np.empty((0, 3)), [], []
    for number, one in enumerate(normal):
        along = np.abs(leaders @ one)
        if not len(along) or along.max() < _ONE_DIRECTION:
            leaders, along = np.vstack([leaders, one]), np.append(along, 1.0)
            count.append(0)
        direction = int(along.argmax())
        if count[direction] < _ASKED_EACH and len(chosen) < _ASKED:
            count[direction] += 1
            chosen.append(number)
    return np.array(chosen, np.int64)


@lru_cache(maxsize=_ASKED + 1)
def _triples(count: int) -> np.ndarray:
    return np.array(list(combinations(range(count), 3)), dtype=np.int64).reshape(-1, 3)


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


def _distinct(t: np.ndarray, score: np.ndarray, apart: float) -> list[tuple[np.ndarray, float]]:
    """The highest scored t (k, 3) and their scores, no two nearer than `apart` [m]."""
    order = np.argsort(-score, kind="stable")
    t, score = t[order], score[order]
    distinct: list[tuple[np.ndarray, float]] = []
    while len(t) and len(distinct) < _MOST_EACH:
        distinct.append((t[0], float(score[0])))
        other = np.linalg.norm(t - t[0], axis=1) > apart
        t, score = t[other], score[other]
    return distinct
