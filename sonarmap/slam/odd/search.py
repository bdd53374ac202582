"""The search for faulty scans: scans that fit no neighbor are changed and registered again."""

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import combinations
from statistics import fmean, median

import numpy as np
from scipy.spatial.transform import RigidTransform

from sonarmap.slam.execute.runner import PairRunner
from sonarmap.slam.odd.odd_scan import FOOT, Change, OddScan
from sonarmap.slam.pair import Candidate, RegisteredPair
from sonarmap.spectral.result import Registration
from sonarmap.spectral.scan import Scan

_MAX_FAILED = 2  # scans for which no change helps; with more, the survey is weak and its scans are not faulty
_MIN_GAIN = 0.4  # of the mean probability with all neighbors by the change
_MAX_STEP = 1.3  # of a changed scan [median steps]: along a quay, a mirrored scan may fit at a wrong place
_ADDED_STEP = 2.0  # added to this [voxels]
_MAX_TURN = float(np.deg2rad(5.0))  # between two registrations that agree [rad]
_MAX_SHIFT = 3.0  # between two registrations that agree [voxels]
_MIN_RATIO = 1.6  # of sizes of a scan in another unit and its neighbors; between meters and feet it is 3.3


def find_odd(
    runner: PairRunner,
    scans: Sequence[Scan],
    surveys: Sequence[int],
    steps: Sequence[RegisteredPair],
    voxel: float,
    vouched: Collection[int] = (),
) -> tuple[OddScan, ...]:
    """The scans that are mirrored, or in feet among meters, by their numbers.

    No registration of such a scan with a neighbor, up to two scans away, is accepted; after the change two of them
    agree on its place. A scan that fits any neighbor is not faulty, such as a mirrored scan of a symmetric place.

    Args:
        runner: of the scans.
        scans, surveys: N, and the number of each one's survey.
        steps: consecutive scans, registered without an expected pose.
        voxel: edge of the survey's voxels [m].
        vouched: scans that are not tested.
    """
    search = _Search(runner, scans, surveys, steps, voxel, {pair.scans: pair for pair in steps})
    suspects = [k for k in search.misfits() if k not in vouched]
    failed = 0
    for k in suspects:
        change = search.changed(k)
        if change is not None:
            search.odd[k] = change
        elif (failed := failed + 1) == _MAX_FAILED:
            break
    return tuple(OddScan(k, search.odd[k]) for k in sorted(search.odd))


@dataclass(frozen=True, slots=True)
class _Search:
    """A search over one survey; its inputs are the arguments of `find_odd`."""

    runner: PairRunner
    scans: Sequence[Scan]
    surveys: Sequence[int]
    steps: Sequence[RegisteredPair]
    voxel: float
    pairs: dict[tuple[int, int], RegisteredPair]  # registered ones, by their scans
    odd: dict[int, Change] = field(default_factory=dict[int, Change])  # results, by scan

    @property
    def longest(self) -> float:
        """Length of the longest plausible step [m]."""
        lengths = [_length(step.registration) for step in self.steps if step.accepted and step.registration]
        return _MAX_STEP * median(lengths or [0.0]) + _ADDED_STEP * self.voxel

    def misfits(self) -> list[int]:
        """Scans without an accepted step, the least probable first."""
        steps: dict[int, list[RegisteredPair]] = {}
        for step in self.steps:
            for k in step.scans:
                steps.setdefault(k, []).append(step)
        fits = {k: _fit(own) for k, own in steps.items() if not any(step.accepted for step in own)}
        return sorted(fits, key=lambda k: fits[k])

    def changed(self, k: int) -> Change | None:
        """The change with which neighbors agree on a scan's place, if none accepts the original scan; else None."""
        unchanged = [self._registered(j, k) for j in self._neighbors(k)]
        if any(pair.accepted for pair in unchanged):
            return None
        registered = any(pair.registration is not None for pair in unchanged)
        return next((each for each in self._changes(k, registered) if self._is_placed(k, each, _fit(unchanged))), None)

    def _neighbors(self, k: int) -> list[int]:
        """Scans of the same survey up to two away, the nearest first, without faulty ones."""
        near = [j for j in (k - 1, k + 1, k - 2, k + 2) if 0 <= j < len(self.scans) and j not in self.odd]
        return [j for j in near if self.surveys[j] == self.surveys[k]]

    def _registered(self, a: int, b: int) -> RegisteredPair:
        """Two original scans, registered without an expected pose."""
        i, j = min(a, b), max(a, b)
        if (i, j) not in self.pairs:
            (self.pairs[i, j],) = self.runner.register([Candidate(i, j, "loop")])
        return self.pairs[i, j]

    def _changes(self, k: int, registered: bool) -> Iterator[Change]:
        """Changes to try. A mirror along x is one along y and a turn about z; a mirror along z puts the bed above. Only
        a scan that could not be `registered` at all has another size."""
        if registered:
            yield Change("y")
            heights = [float(np.median(self.scans[j].points[:, 2])) for j in (k, *self._neighbors(k))]
            if abs(heights[0] + median(heights[1:] or [0.0])) < abs(heights[0] - median(heights[1:] or [0.0])):
                yield Change("z")
        others = [_size(self.scans[j]) for j in self._neighbors(k)]
        ratio = _size(self.scans[k]) / max(fmean(others), 1e-9) if others else 1.0
        if ratio > _MIN_RATIO:
            yield Change(factor=FOOT)
        elif ratio < 1 / _MIN_RATIO:
            yield Change(factor=1 / FOOT)

    def _is_placed(self, k: int, change: Change, before: float) -> bool:
        """Whether neighbors agree on the changed scan's place, with a clearly higher probability than `before`."""
        changed = self.runner.beside([change.of(self.scans[k])], [k])
        tried = [Candidate(j, len(self.scans), "loop") for j in self._neighbors(k)]
        pairs = changed.register(tried[:2])
        if not self._places(pairs, k):
            return False
        pairs += changed.register(tried[2:])
        return _fit(pairs) >= before + _MIN_GAIN and self._agree(self._places(pairs, k))

    def _places(self, pairs: Sequence[RegisteredPair], k: int) -> dict[int, RigidTransform]:
        """T_other_k by the other scan of each accepted pair with the changed scan k as source; none farther away than
        plausible steps lead."""
        return {
            pair.i: pair.registration.T_target_source
            for pair in pairs
            if pair.accepted and pair.registration and _length(pair.registration) <= abs(pair.i - k) * self.longest
        }

    def _agree(self, at: Mapping[int, RigidTransform]) -> bool:
        """Whether two neighbors agree on a scan's place, and no two disagree; `at` is T_neighbor_scan by neighbor."""
        apart = [
            at[i].inv() * between.T_target_source * at[j]
            for i, j in combinations(sorted(at), 2)
            if (between := self._registered(i, j).registration) is not None and between.accepted
        ]
        far = _MAX_SHIFT * self.voxel
        return bool(apart) and all(
            T.rotation.magnitude() < _MAX_TURN and np.linalg.norm(T.translation) < far for T in apart
        )


def _fit(pairs: Sequence[RegisteredPair]) -> float:
    """Mean probability of those that could be registered; 0 without any, as for a scan that is too large for the
    grid."""
    return fmean([pair.registration.probability for pair in pairs if pair.registration is not None] or [0.0])


def _length(registration: Registration) -> float:
    """Distance between the scans [m]."""
    return float(np.linalg.norm(registration.T_target_source.translation))


def _size(scan: Scan) -> float:
    """The median distance of the points from the sensor [m]."""
    return float(np.median(np.linalg.norm(scan.points, axis=1)))
