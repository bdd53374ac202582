"""The largest set of planes that one transform brings together: minimally uncertain maximal consensus (MUMC).

Pathak, Birk, Vaskevicius, Poppinga: Fast registration based on noisy planes with unknown correspondences for 3D
mapping. IEEE Transactions on Robotics 26(3), 2010, DOI 10.1109/TRO.2010.2042989.
"""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import RigidTransform

from sonarmap.tools.lab.baselines.planes.candidates import (
    NORMAL_SLACK,
    PoseCandidates,
    candidates,
    consistent,
    rotations,
    translations,
)
from sonarmap.tools.lab.baselines.planes.fit import Patches
from sonarmap.tools.lab.baselines.planes.pose import PlanePose, Slack, closed_form, compare, refine, settle

# chi-squared of three degrees of freedom, 99.9 %
_GATE = 16.27
_ROUNDS = 4
# What the planes of one surface differ by when other parts of it are seen [voxels].
_SHIFT_SLACK = 0.35
# Patches meet whose middles are no farther apart than so many standard deviations of both extents.
_REACH = 1.3
# Of the sets with nearly as many planes as the largest the least uncertain is preferred.
_AS_MANY = 0.9
_MOST_ROTATIONS = 40
_MOST_STARTS = 100
_MOST_SINGLE = 30


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
        self._pairs = candidates(target, source, max_tilt)
        self._slack = Slack(NORMAL_SLACK, _SHIFT_SLACK * voxel)
        self._seen: set[bytes] = set()

    def find(self) -> list[Consensus]:
        """Sets of planes that agree on a transform, best first; empty where not even two do.

        As in the paper sets grow from pairs of candidates that give a rotation, by what is consistent with it, then
        by the translation; of the largest sets that of the least uncertain transform wins. Unlike there the pairs'
        rotations are pooled first, so that a set is grown once for all pairs that would grow it.
        """
        sets = self._grown(self._starts()) or self._grown(self._parallel_starts())
        if sets:
            good = [each for each in sets if len(each) >= _AS_MANY * len(sets[0])]
            best = min(good, key=_volume)
            sets = [self._settled(best), *(each for each in sets if each is not best)]
        return sets

    def _settled(self, consensus: Consensus) -> Consensus:
        planes = self.target.take(consensus.target), self.source.take(consensus.source)
        return replace(consensus, pose=settle(*planes, consensus.pose.T_target_source, self.farthest, self._slack))

    def _grown(self, starts: Iterable[RigidTransform]) -> list[Consensus]:
        """What grows from the starts, most planes first."""
        grown = [self._grow(start) for start in starts]
        return sorted((each for each in grown if each is not None), key=lambda each: (-len(each), _volume(each)))

    def _starts(self) -> list[RigidTransform]:
        """Transforms that pairs and triples of planes give, those on which most agree."""
        scored: list[tuple[float, RigidTransform]] = []
        for R in rotations(self.target, self.source, self._pairs, self.max_tilt, _MOST_ROTATIONS):
            chosen = consistent(self.target, self.source, self._pairs, R, NORMAL_SLACK)
            bounds = (self.farthest, self.voxel)
            for t, score in translations(self.target, self.source, self._pairs, chosen, R, bounds):
                scored.append((score, RigidTransform.from_components(t, R)))
        scored.sort(key=lambda start: -start[0])
        return [start for _, start in scored[:_MOST_STARTS]]

    def _parallel_starts(self) -> Iterator[RigidTransform]:
        """Where all planes are parallel: the smallest rotation for each of the largest candidates."""
        for one in range(min(_MOST_SINGLE, len(self._pairs))):
            index = np.array([one])
            yield closed_form(*self._planes(index))

    def _grow(self, start: RigidTransform) -> Consensus | None:
        """The planes that a transform brings together, and the transform that these give, in turn.

        None where they are fewer than two, or a set that was grown before.
        """
        T, slack = start, Slack(2 * NORMAL_SLACK, self.voxel)
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
        area = float(self._pairs.area[index].sum())
        return Consensus(pose, self._pairs.target[index], self._pairs.source[index], area)

    def _planes(self, index: np.ndarray) -> tuple[Patches, Patches]:
        return self.target.take(self._pairs.target[index]), self.source.take(self._pairs.source[index])

    def _matches(self, T: RigidTransform, slack: Slack) -> np.ndarray:
        """The candidates (n,) that T brings together: one plane, patches that meet, each once, largest first."""
        index = np.flatnonzero(_meet(self.target, self.source, T)[self._pairs.target, self._pairs.source])
        index = index[compare(*self._planes(index), T, slack) <= _GATE]
        return index[_each_once(self._pairs, index)]


def _each_once(pairs: PoseCandidates, index: np.ndarray) -> list[int]:
    """Which of `index` remain if every patch may be in one pair, the first."""
    kept: list[int] = []
    mine: set[int] = set()
    others: set[int] = set()
    for place, (i, j) in enumerate(zip(pairs.target[index].tolist(), pairs.source[index].tolist(), strict=True)):
        if i not in mine and j not in others:
            kept.append(place)
            mine.add(i)
            others.add(j)
    return kept


def _volume(one: Consensus) -> float:
    """The logarithm of the determinant of a transform's covariance."""
    return float(np.linalg.slogdet(one.pose.covariance)[1])


def _meet(target: Patches, source: Patches, T: RigidTransform) -> np.ndarray:
    """(Kt, Ks) bool: whether patches lie at one place, by their extents along the line between their middles."""
    R = T.rotation.as_matrix()
    line = T.apply(source.middle)[None] - target.middle[:, None]
    length = np.linalg.norm(line, axis=2)
    way = line / np.maximum(length, 1e-9)[..., None]
    reach = np.sqrt(np.einsum("tsi,tij,tsj->ts", way, target.spread, way))
    reach = reach + np.sqrt(np.einsum("tsi,sij,tsj->ts", way, R @ source.spread @ R.T, way))
    return length <= _REACH * reach + 1e-9
