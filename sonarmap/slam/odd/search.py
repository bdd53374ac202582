"""The search for odd scans: those that fit no neighbor are changed and registered again."""

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

_MOST = 2  # scans that are tried in vain: where more do not fit, the survey is weak, and no scan odd
# By so much the mean probability with all neighbors is higher with the change: of mirrored scans by 0.68 and more.
_CLEARLY = 0.4
# A mirrored scan may fit at a wrong place, along a quay; a step beyond so many usual ones, and voxels, does not count.
_LONG, _LONGER = 1.3, 2.0
# Two answers agree that are no farther apart [rad, voxels].
_SAME_TURN, _SAME_PLACE = float(np.deg2rad(5.0)), 3.0
# A scan in feet among others in meters is 3.3 times as large: only one that is so much larger or smaller is tried.
_LARGER = 1.6


def find_odd(
    runner: PairRunner,
    scans: Sequence[Scan],
    surveys: Sequence[int],
    steps: Sequence[RegisteredPair],
    voxel: float,
    vouched: Collection[int] = (),
) -> tuple[OddScan, ...]:
    """The scans that are mirrored, or in feet among meters, by their numbers.

    No registration of such a scan with a neighbor, up to two scans away, is accepted as it is; changed, it lies at the
    same place by two of them. A scan that any neighbor fits is never odd, as a mirrored scan of a symmetric place.

    Args:
        runner: of the scans.
        scans, surveys: N, and the number of each one's survey.
        steps: consecutive scans, registered freely.
        voxel: edge of the survey's voxels [m].
        vouched: scans that are not asked about.
    """
    search = _Search(runner, scans, surveys, steps, voxel, {pair.scans: pair for pair in steps})
    suspects = [k for k in search.misfits() if k not in vouched]
    in_vain = 0
    for k in suspects:
        change = search.changed(k)
        if change is not None:
            search.odd[k] = change
        elif (in_vain := in_vain + 1) == _MOST:
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
    pairs: dict[tuple[int, int], RegisteredPair]  # that are registered, by their scans
    odd: dict[int, Change] = field(default_factory=dict[int, Change])  # results, by scan

    @property
    def longest(self) -> float:
        """The longest step that is not surprising [m]."""
        lengths = [_length(step.registration) for step in self.steps if step.accepted and step.registration]
        return _LONG * median(lengths or [0.0]) + _LONGER * self.voxel

    def misfits(self) -> list[int]:
        """Scans with steps of which none is accepted, the least probable first."""
        steps: dict[int, list[RegisteredPair]] = {}
        for step in self.steps:
            for k in step.scans:
                steps.setdefault(k, []).append(step)
        fits = {k: _fit(own) for k, own in steps.items() if not any(step.accepted for step in own)}
        return sorted(fits, key=lambda k: fits[k])

    def changed(self, k: int) -> Change | None:
        """The change with which a scan lies where neighbors agree that it does, while none accepts it as it is."""
        as_it_is = [self._registered(j, k) for j in self._neighbors(k)]
        if any(pair.accepted for pair in as_it_is):
            return None
        registered = any(pair.registration is not None for pair in as_it_is)
        return next((each for each in self._changes(k, registered) if self._is_placed(k, each, _fit(as_it_is))), None)

    def _neighbors(self, k: int) -> list[int]:
        """Scans of the same survey up to two away, the nearest first, without odd ones."""
        near = [j for j in (k - 1, k + 1, k - 2, k + 2) if 0 <= j < len(self.scans) and j not in self.odd]
        return [j for j in near if self.surveys[j] == self.surveys[k]]

    def _registered(self, a: int, b: int) -> RegisteredPair:
        """Two scans as they are, registered freely."""
        i, j = min(a, b), max(a, b)
        if (i, j) not in self.pairs:
            (self.pairs[i, j],) = self.runner.register([Candidate(i, j, "loop")])
        return self.pairs[i, j]

    def _changes(self, k: int, registered: bool) -> Iterator[Change]:
        """Those that may make a scan fit. Mirrored along x is along y and turned about z; along z, the bed is above.
        A scan that cannot be `registered` at all has another size."""
        if registered:
            yield Change("y")
            heights = [float(np.median(self.scans[j].points[:, 2])) for j in (k, *self._neighbors(k))]
            if abs(heights[0] + median(heights[1:] or [0.0])) < abs(heights[0] - median(heights[1:] or [0.0])):
                yield Change("z")
        others = [_size(self.scans[j]) for j in self._neighbors(k)]
        times = _size(self.scans[k]) / max(fmean(others), 1e-9) if others else 1.0
        if times > _LARGER:
            yield Change(factor=FOOT)
        elif times < 1 / _LARGER:
            yield Change(factor=1 / FOOT)

    def _is_placed(self, k: int, change: Change, as_it_is: float) -> bool:
        """Whether neighbors agree where the changed scan lies, and are clearly surer than of the scan `as_it_is`."""
        changed = self.runner.beside([change.of(self.scans[k])], [k])
        tried = [Candidate(j, len(self.scans), "loop") for j in self._neighbors(k)]
        pairs = changed.register(tried[:2])
        if not self._places(pairs, k):
            return False
        pairs += changed.register(tried[2:])
        return _fit(pairs) >= as_it_is + _CLEARLY and self._agree(self._places(pairs, k))

    def _places(self, pairs: Sequence[RegisteredPair], k: int) -> dict[int, RigidTransform]:
        """T_other_k by the other scan of each accepted pair, of which the changed scan k is the source; none farther
        away than by usual steps."""
        return {
            pair.i: pair.registration.T_target_source
            for pair in pairs
            if pair.accepted and pair.registration and _length(pair.registration) <= abs(pair.i - k) * self.longest
        }

    def _agree(self, at: Mapping[int, RigidTransform]) -> bool:
        """Whether two neighbors say alike where a scan lies, and no two otherwise; by their number, T_neighbor_scan."""
        apart = [
            at[i].inv() * between.T_target_source * at[j]
            for i, j in combinations(sorted(at), 2)
            if (between := self._registered(i, j).registration) is not None and between.accepted
        ]
        far = _SAME_PLACE * self.voxel
        return bool(apart) and all(
            T.rotation.magnitude() < _SAME_TURN and np.linalg.norm(T.translation) < far for T in apart
        )


def _fit(pairs: Sequence[RegisteredPair]) -> float:
    """Mean probability of those that could be registered; 0 where none could, as of a scan that is too large for the
    grid."""
    return fmean([pair.registration.probability for pair in pairs if pair.registration is not None] or [0.0])


def _length(registration: Registration) -> float:
    """Of the way between the scans [m]."""
    return float(np.linalg.norm(registration.T_target_source.translation))


def _size(scan: Scan) -> float:
    """The median distance of the points from the sensor [m]."""
    return float(np.median(np.linalg.norm(scan.points, axis=1)))
