# pyright: strict, reportMissingTypeStubs=false, reportUnknownMemberType=false
"""The search for odd scans: those whose steps do not fit are changed and registered again, and stretched ones too."""

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from itertools import combinations
from math import exp, log
from statistics import fmean, median

import numpy as np
from scipy.spatial.transform import RigidTransform

from sonarmap.slam.execute.runner import PairRunner
from sonarmap.slam.odd.odd_scan import FOOT, Change, OddScan
from sonarmap.slam.pair import Candidate, RegisteredPair
from sonarmap.spectral.result import Registration
from sonarmap.spectral.scan import Scan

_MOST = 2  # scans that are tried of each kind in vain: where more do not fit, the survey is weak, and no scan odd
# Mean probability of a scan's steps from which on it fits as it is.
_FITS = 0.75
# By so much the mean probability with all neighbors is higher with the change: of a scan between the walls of a pool by
# 0.20, which was as it should be; of mirrored ones by 0.68 and more.
_CLEARLY = 0.4
# A mirrored scan may fit at a wrong place, along a quay; a step beyond so many usual ones, and voxels, does not count.
_LONG, _LONGER = 1.3, 2.0
# Two answers agree that are no farther apart [rad, voxels].
_SAME_TURN, _SAME_PLACE = float(np.deg2rad(5.0)), 3.0
# A scan in feet among others in meters is 3.3 times as large: only one that is so much larger or smaller is tried.
_LARGER = 1.6
# Mean difference of the stretches, all of one sign, from which on a scan is tried, and the least of any step. Of 40
# ordinary scans of ten scenes none reached it, of 72 whose ranges were off by 5 % 68 did, and 1 of 8 in a pool.
_TRIED, _TRIED_ALONE, _EACH = 0.0019, 0.0025, 0.0008
# And as a multiple of what other steps differ by in the median: where all scans are bent, none is odd for it.
_BEYOND_OTHERS = 3.0
_TRIAL = log(1.05)  # by so much the ranges of a scan are changed to see how the stretch follows
_TELLING = 0.0015  # change of the stretch by that trial from which on a pair tells the ranges
# A scan is odd whose ranges are off by more than this: ordinary ones that two pairs tell, by up to 0.9 % but in a pool.
_ODD = 0.025
_APART = 2.0  # times by which no pair's answer may be above or below the median of all


def find_odd(
    runner: PairRunner,
    scans: Sequence[Scan],
    surveys: Sequence[int],
    steps: Sequence[RegisteredPair],
    voxel: float,
    vouched: Collection[int] = (),
) -> tuple[OddScan, ...]:
    """The scans that are mirrored, in feet among meters, or whose ranges are off by a share, by their numbers.

    Neighbors say so: two of them, up to two scans away, at which the changed scan lies at the same place, or by whose
    overlap the ranges have to be changed by about the same share. What fits as it is, as a mirrored scan of a
    symmetric place does, is never odd.

    Args:
        runner: of the scans.
        scans, surveys: N, and the number of each one's survey.
        steps: consecutive scans, registered freely.
        voxel: edge of the survey's voxels [m].
        vouched: scans that are not asked about.
    """
    search = _Search(runner, scans, surveys, steps, voxel)
    search.examine(search.misfits, search.changed, vouched)
    search.examine(search.stretched, search.scaled, vouched)
    return tuple(OddScan(k, search.odd[k]) for k in sorted(search.odd))


class _Search:
    """With the odd scans that it has found so far; arguments as of `find_odd`."""

    def __init__(
        self,
        runner: PairRunner,
        scans: Sequence[Scan],
        surveys: Sequence[int],
        steps: Sequence[RegisteredPair],
        voxel: float,
    ) -> None:
        self._runner, self._scans, self._surveys, self._voxel = runner, scans, surveys, voxel
        self._pairs, self._steps = {pair.scans: pair for pair in steps}, steps
        lengths = [_length(step.registration) for step in steps if step.accepted and step.registration]
        self._longest = _LONG * median(lengths or [0.0]) + _LONGER * voxel  # step that is not surprising [m]
        self.odd: dict[int, Change] = {}

    def examine(
        self,
        suspects: Callable[[], list[int]],
        change_of: Callable[[int], Change | None],
        vouched: Collection[int],
    ) -> None:
        """Look for the change of each suspect, the worst first; what was found takes the blame off its neighbors."""
        in_vain = set[int]()
        while len(in_vain) < _MOST:
            k = next((k for k in suspects() if not (k in in_vain or k in vouched or k in self.odd)), None)
            if k is None:
                return
            change = change_of(k)
            if change is None:
                in_vain.add(k)
            else:
                self.odd[k] = change

    def misfits(self) -> list[int]:
        """Scans whose steps are hardly believed, the least believed first."""
        fits = {k: _fit(own, self._longest) for k, own in self._by_scan().items()}
        return sorted((k for k, fit in fits.items() if fit < _FITS), key=lambda k: fits[k])

    def stretched(self) -> list[int]:
        """Scans that all believed steps find too short or too long, those first that most is said of."""
        said = {
            k: [stretch for step in steps if (stretch := _stretch(step, k)) is not None]
            for k, steps in self._by_scan().items()
        }
        suspects = [
            k
            for k, each in said.items()
            if each
            and abs(fmean(each)) >= (_TRIED if len(each) > 1 else _TRIED_ALONE)
            and min(stretch * np.sign(fmean(each)) for stretch in each) >= _EACH
            and abs(fmean(each)) >= _BEYOND_OTHERS * self._usual(k)
        ]
        return sorted(suspects, key=lambda k: -abs(sum(said[k])))

    def _usual(self, k: int) -> float:
        """The median of what the believed steps without a scan stretch by, either way; 0 where there are none."""
        others = [_stretch(step, step.j) for step in self._steps if k not in step.scans]
        return median([abs(each) for each in others if each is not None] or [0.0])

    def changed(self, k: int) -> Change | None:
        """The change with which a scan lies where neighbors agree that it does, as they do not of the scan as it is."""
        if self._fits_as_it_is(self._by_scan()[k], k):
            return None
        change = next((change for change in self._changes(k) if self._is_placed(k, change)), None)
        if change is None or self._fits_as_it_is([self._registered(j, k) for j in self._neighbors(k)], k):
            return None
        return change

    def scaled(self, k: int) -> Change | None:
        """The factor of a scan's ranges that its neighbors agree on; None where it is near 1 or they do not agree."""
        near = self._neighbors(k)
        plain = {j: _stretch(self._registered(j, k), k) for j in near}
        known = {j: stretch for j, stretch in plain.items() if stretch is not None}
        if len(known) < 2:
            return None
        trial = float(np.copysign(_TRIAL, sum(known.values())))
        logs: dict[int, float] = {}
        for pair in self._tried(k, Change(factor=exp(trial)), list(known)):
            after = _stretch(pair, pair.j)
            if after is not None and abs(known[pair.i] - after) >= _TELLING:
                # the stretch is linear in the scale: it vanishes where the ranges are right
                logs[pair.i] = trial * known[pair.i] / (known[pair.i] - after)
        # of scans on one side alone, the place where these are may be wrong
        if len(logs) < 2 or {j > k for j in logs} != {j > k for j in near}:
            return None
        middle = median(logs.values())
        agree = all(1 / _APART < each / middle < _APART for each in logs.values()) if middle else False
        return Change(factor=exp(middle)) if agree and abs(middle) >= _ODD else None

    def _by_scan(self) -> dict[int, list[RegisteredPair]]:
        """The steps of every scan, but for those to odd ones."""
        steps: dict[int, list[RegisteredPair]] = {}
        for step in self._steps:
            if self.odd.keys().isdisjoint(step.scans):
                for k in step.scans:
                    steps.setdefault(k, []).append(step)
        return steps

    def _neighbors(self, k: int) -> list[int]:
        """Scans of the same survey up to two away, the nearest first, without odd ones."""
        near = [j for j in (k - 1, k + 1, k - 2, k + 2) if 0 <= j < len(self._scans) and j not in self.odd]
        return [j for j in near if self._surveys[j] == self._surveys[k]]

    def _registered(self, a: int, b: int) -> RegisteredPair:
        """Two scans as they are, registered freely."""
        i, j = min(a, b), max(a, b)
        if (i, j) not in self._pairs:
            (self._pairs[i, j],) = self._runner.register([Candidate(i, j, "loop")])
        return self._pairs[i, j]

    def _tried(self, k: int, change: Change, near: Sequence[int]) -> list[RegisteredPair]:
        """The scan, changed, as the source of a pair with each of these."""
        beside = self._runner.beside([change.of(self._scans[k])], [k])
        return beside.register([Candidate(j, len(self._scans), "loop") for j in near])

    def _changes(self, k: int) -> Iterator[Change]:
        """Those that may make a scan fit. Mirrored along x is along y and turned about z; along z, the bed is above."""
        if any(step.registration is not None for step in self._by_scan()[k]):
            yield Change("y")
            heights = [float(np.median(self._scans[j].points[:, 2])) for j in (k, *self._neighbors(k))]
            if abs(heights[0] + median(heights[1:] or [0.0])) < abs(heights[0] - median(heights[1:] or [0.0])):
                yield Change("z")
        others = [_size(self._scans[j]) for j in self._neighbors(k)]
        times = _size(self._scans[k]) / max(fmean(others), 1e-9) if others else 1.0
        if times > _LARGER:
            yield Change(factor=FOOT)
        elif times < 1 / _LARGER:
            yield Change(factor=1 / FOOT)

    def _is_placed(self, k: int, change: Change) -> bool:
        """Whether neighbors agree where the changed scan lies, and clearly surer than of the scan as it is."""
        near = self._neighbors(k)
        pairs = self._tried(k, change, near[:2])
        if not self._places(pairs, k, self._longest):
            return False
        pairs += self._tried(k, change, near[2:])
        as_it_is = [self._registered(j, k) for j in near]
        jumps = self._jumps(self._places(as_it_is, k, np.inf), k)
        clear = jumps or _fit(pairs, np.inf) >= _fit(as_it_is, np.inf) + _CLEARLY
        return clear and self._agree(self._places(pairs, k, self._longest))

    def _fits_as_it_is(self, pairs: Sequence[RegisteredPair], k: int) -> bool:
        """Whether these pairs of a scan agree where it lies; those that leave it near, if all are on one side of it or
        it jumps away from them."""
        at = self._places(pairs, k, np.inf)
        near = len({j > k for j in at}) < 2 or self._jumps(at, k)
        return self._agree(at) and (not near or self._agree(self._places(pairs, k, self._longest)))

    def _jumps(self, at: Mapping[int, RigidTransform], k: int) -> bool:
        """Whether a scan lies far from the neighbors before and behind it, which are near each other: nobody goes there
        and back, but a mirrored scan of a symmetric place lies on its other side."""
        far = [j for j, T in at.items() if float(np.linalg.norm(T.translation)) > abs(j - k) * self._longest]
        return any(
            (between := self._registered(i, j).registration) is not None
            and between.accepted
            and _length(between) <= (j - i) * self._longest
            for i, j in combinations(sorted(far), 2)
            if i < k < j
        )

    def _places(self, pairs: Sequence[RegisteredPair], k: int, longest: float) -> dict[int, RigidTransform]:
        """T_other_k by the other scan of each accepted pair, of which `k`, if it was changed, is the source; none
        farther away than by steps of this length [m]."""
        places: dict[int, RigidTransform] = {}
        for pair in pairs:
            other, given = pair.j if pair.i == k else pair.i, pair.registration
            if given is not None and given.accepted and _length(given) <= abs(other - k) * longest:
                places[other] = given.T_target_source.inv() if pair.i == k else given.T_target_source
        return places

    def _agree(self, at: Mapping[int, RigidTransform]) -> bool:
        """Whether two neighbors say alike where a scan lies, and no two otherwise; by their number, T_neighbor_scan."""
        agree = [
            self._same_place(at[i], between.T_target_source * at[j])
            for i, j in combinations(sorted(at), 2)
            if (between := self._registered(i, j).registration) is not None and between.accepted
        ]
        return bool(agree) and all(agree)

    def _same_place(self, T: RigidTransform, other: RigidTransform) -> bool:
        apart = T.inv() * other
        far = float(np.linalg.norm(apart.translation))
        return float(apart.rotation.magnitude()) < _SAME_TURN and far < _SAME_PLACE * self._voxel


def _fit(steps: Sequence[RegisteredPair], longest: float) -> float:
    """Mean probability of those that could be registered, 0 of steps that are longer [m]; 0 where none could, as of a
    scan that is too large for the grid."""
    given = [step.registration for step in steps if step.registration is not None]
    return fmean([0.0 if _length(each) > longest else each.probability for each in given] or [0.0])


def _length(registration: Registration) -> float:
    """Of the way between the scans [m]."""
    return float(np.linalg.norm(registration.T_target_source.translation))


def _stretch(pair: RegisteredPair, k: int) -> float | None:
    """By which share more than the other's the ranges of scan k are too short, as far as the registration follows that;
    None where it does not say, or is not accepted."""
    registration = pair.registration
    if registration is None or not registration.accepted:
        return None
    stretch = dict(registration.evidence).get("stretch")
    return stretch if stretch is None or pair.j == k else -stretch


def _size(scan: Scan) -> float:
    """The median distance of the points from the sensor [m]."""
    return float(np.median(np.linalg.norm(scan.points, axis=1)))
