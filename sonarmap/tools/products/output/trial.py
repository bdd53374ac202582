"""Instruments on trial: faults of the sonar and the navigation, by the evidence so far.

`inspect` has scans only. `map` adds navigation, registrations without priors, and the finished map. `live` repeats the
trial during the dive.
"""

from collections.abc import Callable, Hashable, Iterator, Sequence
from dataclasses import dataclass, field
from hashlib import blake2b

import numpy as np
from scipy.spatial.transform import RigidTransform

from sonarmap.slam.motion.sweep import Sweep
from sonarmap.slam.odd.standing import StandingParts, in_words
from sonarmap.slam.pair import RegisteredPair
from sonarmap.slam.survey_result import SurveyResult
from sonarmap.spectral.scan import Scan
from sonarmap.tools.files.finding import Finding, Remedy
from sonarmap.tools.files.geo import Georeference
from sonarmap.tools.files.readers.navigation.contradictions import (
    LEAST_PAIRS,
    UPSIDE_DOWN,
    Contradiction,
    Registered,
    contradiction,
    contradiction_of_map,
)
from sonarmap.tools.files.time_scales import clock_faults, clock_of
from sonarmap.tools.products.output.faults import instrument_faults, scale_of, systematic_words
from sonarmap.tools.products.output.upside_down import Cloud, upside_down

_MIN_REPEATS, _MIN_REPEATED = 3, 0.05  # number and share of repeated scans that are reported
_MIN_STEPS = 16  # between scans, from which lost scans are counted
_MIN_GAPS, _MIN_LOST = 3, 0.05  # number and share of gaps between scans that are reported
_EVEN, _MOSTLY = 0.2, 0.9  # steps are whole numbers of periods up to this share of one; share of the steps
_PAUSE = 10  # periods: a longer gap is a pause
_MOST_PAIRS = 128  # registrations that are compared with the navigation, evenly chosen


@dataclass(slots=True)
class ScansOnTrial:
    """What scans show by themselves, added one by one."""

    standing: StandingParts = field(default_factory=StandingParts)
    _stamps: dict[Hashable, list[float]] = field(default_factory=dict[Hashable, list[float]])  # by survey
    _times: list[float | None] = field(default_factory=list[float | None])
    _spans: list[float] = field(default_factory=list[float])
    _seen: set[bytes] = field(default_factory=set[bytes])
    _repeated: list[str] = field(default_factory=list[str])  # names of scans equal to an earlier one

    def add(self, scan: Scan, stamp: float | None, survey: Hashable = 0, span: float = 0.0) -> None:
        """Add a scan, with the stamp of its file [s] and the span of its points' times as read."""
        self._times.append(stamp)
        self._spans.append(span)
        self.standing.add(scan)
        if stamp is not None:
            self._stamps.setdefault(survey, []).append(stamp)
        if (key := blake2b(scan.points.tobytes(), digest_size=16).digest()) in self._seen:
            self._repeated.append(scan.name)
        self._seen.add(key)

    @property
    def sweep(self) -> Sweep:
        """How long the sensor takes for a scan."""
        return Sweep.of(self._spans, self._times)

    def found(self, unread: int = 0) -> Iterator[Finding]:
        """Faults of the scans; `unread`: number of scans that could not be read."""
        yield from map(Finding, self.sweep.notes)
        if parts := self.standing.found():
            yield Finding(in_words(parts), (Remedy("exclude_box", tuple(part.corners for part in parts)),))
        if len(self._repeated) >= max(_MIN_REPEATS, _MIN_REPEATED * len(self._times)):
            yield Finding(
                f"{len(self._repeated)} of {len(self._times)} scans repeat an earlier one point for point, the first "
                f"{self._repeated[0]}: the sonar or its driver hangs. Restart it, and leave these scans out"
            )
        for stamps in self._stamps.values():
            yield from map(Finding, _of_clock(np.array(stamps), unread))


def _of_clock(stamps: np.ndarray, unread: int) -> Iterator[str]:
    """Sentences about the stamps (n,) of a survey [s]: a clock that stands still or was set back, and lost scans."""
    clock = clock_of(stamps)
    if clock.stands_still or clock.backward:
        yield clock_faults(clock)[0]
    elif (lost := _lost(np.diff(stamps), clock.period) - unread) > 0:
        count = lost + len(stamps)
        yield (
            f"{lost} of {count} scans ({100 * lost / count:.0f} %) are missing by their times, {clock.period:.3g} s "
            "apart otherwise, as if packets were lost: look at cable, switch and receive buffer (net.core.rmem_max)"
        )


def _lost(steps: np.ndarray, period: float) -> int:
    """Number of scans that are missing in steps (n,) [s] of usually one period; 0 if steps are uneven, or long ones
    are few, or follow each other as at another rate."""
    if len(steps) < _MIN_STEPS or not period:
        return 0
    number = np.rint(steps / period)
    gaps = (number >= 2) & (number <= _PAUSE)
    even = np.abs(steps / period - number) <= _EVEN
    many = gaps.sum() >= max(_MIN_GAPS, _MIN_LOST * len(steps))
    scattered = (gaps[1:] & gaps[:-1]).sum() <= gaps.sum() / 2
    return int((number[gaps] - 1).sum()) if many and scattered and even.mean() >= _MOSTLY else 0


@dataclass(frozen=True, slots=True)
class MeasuredScans:
    """Scans with what navigation measured."""

    scans: Sequence[Scan]  # with priors
    named: str = ""  # the files, in words; "" for what recordings measured
    georeference: Georeference | None = None  # of the priors' positions
    axes: str | None = None  # of the points in files, if they were given

    @property
    def _origin(self) -> tuple[float, float] | None:
        place = self.georeference
        return None if place is None else (place.latitude, place.longitude)

    def contradiction(self, free: Sequence[RegisteredPair]) -> Contradiction | None:
        """The mistake that pairs registered without the priors show; None for none or too few pairs."""
        pairs = [(*pair.scans, pair.registration) for pair in free if pair.registration is not None]
        pairs = pairs[:: len(pairs) // _MOST_PAIRS + 1]
        if len(pairs) < LEAST_PAIRS:
            return None
        i, j, registrations = zip(*pairs, strict=True)
        T = RigidTransform.concatenate([each.T_target_source for each in registrations])
        registered = Registered(np.array(i), np.array(j), T, np.array([each.covariance for each in registrations]))
        return contradiction([scan.prior for scan in self.scans], registered, self._origin)

    def finding(self, found: Contradiction) -> Finding:
        """The mistake with its remedies."""
        steps = np.diff([scan.stamp for scan in self.scans])
        remedies = found.remedies(float(np.median(steps)) if len(steps) else 0.0, self.axes or "flu")
        where = self.named or "what recordings measured"
        words = f"{found}. In {where}: give {', or '.join(map(str, remedies))}"
        return Finding(words, tuple(each for each in remedies if self.named and isinstance(each, Remedy)))

    def mistake(self, result: SurveyResult, clouds: Callable[[], Sequence[Cloud]] | None) -> Finding | None:
        """The mistake that explains why instruments contradict a map. Whether it is upside down is asked only with its
        `clouds`."""
        found = None
        if result.understated:
            priors = [scan.prior for scan in self.scans]
            found = contradiction_of_map(result.solution.graph, priors, tuple(result.understated), self._origin)
        if found is not None:
            return self.finding(found)
        words = "" if clouds is None else upside_down(result, self.scans, clouds())
        return Finding(words, (UPSIDE_DOWN,) if self.named else ()) if words else None


@dataclass(frozen=True, slots=True)
class Evidence:
    """All that is known so far."""

    scans: ScansOnTrial = field(default_factory=ScansOnTrial)
    unread: int = 0  # number of scans that could not be read
    of_files: Sequence[str] = ()  # what is wrong with the files of navigation by themselves
    measured: MeasuredScans | None = None
    free: Sequence[RegisteredPair] = ()  # pairs registered without the priors
    result: SurveyResult | None = None  # the map
    clouds: Callable[[], Sequence[Cloud]] | None = None  # its points


def on_trial(evidence: Evidence) -> list[Finding]:
    """Faults of the instruments, with the option or setting that corrects each."""
    measured, result = evidence.measured, evidence.result
    found = [*evidence.scans.found(evidence.unread), *map(Finding, evidence.of_files)]
    if measured is not None and (contradicted := measured.contradiction(evidence.free)) is not None:
        return [*found, measured.finding(contradicted)]  # faults of the map are its consequences
    if result is None:
        return found
    if measured is not None and (mistake := measured.mistake(result, evidence.clouds)) is not None:
        found.append(mistake)
    remedies = dict[str, tuple[Remedy, ...]]()
    if (shared := result.systematic) is not None and (scale := scale_of(shared)):
        remedies[systematic_words(shared)] = (Remedy("range_scale", (scale,)),)
    return [*found, *(Finding(words, remedies.get(words, ())) for words in instrument_faults(result, result.names))]
