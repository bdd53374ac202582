"""Groups of scans whose ranges are longer or shorter than those of the others, as by another speed of sound.

Registrations estimate only a part of the share by which a scan is too long, and this part differs between scenes. Their
estimates show which scans differ; registrations with these scans changed by a known share calibrate the estimates.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from sonarmap.slam.execute.runner import PairRunner
from sonarmap.slam.odd.odd_scan import Change
from sonarmap.slam.pair import Candidate, RegisteredPair
from sonarmap.spectral.chi_squared import chi_squared_beyond
from sonarmap.spectral.scan import Scan

MIN_SCALE = 0.01  # share of the ranges
MIN_OVERLAP = 0.3  # of a pair that shows a scale
MIN_SIGMA = 4e-4  # scatter of the estimates of right scans [share of the ranges]
FALSE_ALARMS = 1e-6  # probability that scatter alone makes a group of a survey suspicious
MIN_SIGMAS = 5.0  # standard deviations by which the measured share differs from 0
MIN_PAIRS, MAX_PAIRS = 3, 10  # between the group and the others
TRIED = 0.03  # share by which a suspicious group is changed
SYSTEMATIC = 0.1  # relative standard deviation of the measured share, as responses are not linear


@dataclass(frozen=True, slots=True)
class ScaledScans:
    """A group of scans with other ranges than the rest."""

    scans: tuple[int, ...]  # the smaller group, ascending
    longer: float  # share by which its ranges are longer than those of the others, negative if shorter
    sigma: float  # standard deviation of that share


def find_scaled(runner: PairRunner, scans: Sequence[Scan], pairs: Sequence[RegisteredPair]) -> ScaledScans | None:
    """The group of scans whose ranges differ from the others' by 1 % or more; None if there is none.

    Args:
        runner: of the scans.
        pairs: accepted ones of one component, consecutive ones first.
    """
    shown = {pair.scans: share for pair in pairs if (share := _longer(pair)) is not None}
    if len(shown) < MIN_PAIRS:
        return None
    shares = _Shares(np.array(list(shown)), np.array(list(shown.values())))
    group = shares.group(len(scans))
    seen = np.unique(shares.scans)
    if 2 * np.sum(group[seen]) > len(seen) or (2 * np.sum(group[seen]) == len(seen) and group[seen[0]]):
        group = ~group
    across = shares.across(group)
    chosen = np.flatnonzero(across)[:MAX_PAIRS]
    if not len(chosen):
        return None
    ends = np.where(across[chosen, None] > 0, shares.scans[chosen], shares.scans[chosen, ::-1])
    measured = _measured(runner, scans, ends, across[chosen] * shares.longer[chosen])
    return measured and ScaledScans(tuple(seen[group[seen]].tolist()), *measured)


@dataclass(frozen=True, slots=True)
class _Shares:
    """Shares by which the ranges of scans seem to differ, by P pairs."""

    scans: np.ndarray  # (P, 2) target and source
    longer: np.ndarray  # (P,) of the source relative to the target, a part of the true share

    def group(self, count: int) -> np.ndarray:
        """(N,) bool, the group whose scale explains the shares best; empty if scatter may explain them.

        In each step one scan, all scans up to it, or every second scan change sides, as long as that explains clearly
        more. A run of scans in the middle takes two steps.
        """
        group, explained = np.zeros(count, bool), 0.0
        while True:
            changed = max((group ^ change for change in _changes(count)), key=lambda each: self._explained(each)[0])
            squares, variance = self._explained(changed)
            if squares - explained <= float(chi_squared_beyond(FALSE_ALARMS / count, 1)) * variance:
                return group
            group, explained = changed, squares

    def across(self, group: np.ndarray) -> np.ndarray:
        """(P,) 1 where the source alone is in the group, -1 where the target alone is, else 0."""
        return group[self.scans] @ np.array([-1.0, 1.0])

    def _explained(self, group: np.ndarray) -> tuple[float, float]:
        """Squares of the shares that a scale of the group explains, and the variance of the others without outliers."""
        across = self.across(group)
        between = max(float(across @ across), 1.0)
        rest = np.abs(self.longer - across * (across @ self.longer) / between)
        sigma = max(1.48 * float(np.median(rest)), MIN_SIGMA)
        variance = max(float(np.mean(np.minimum(rest, 3 * sigma) ** 2)), sigma**2)
        return float((across @ self.longer) ** 2 / between) if between >= MIN_PAIRS else 0.0, variance


def _changes(count: int) -> Iterator[np.ndarray]:
    """(N,) bool each, the scans that change sides together."""
    taken = np.arange(count)
    yield taken % 2 == 1
    for k in range(count):
        yield from (taken == k, taken <= k)


def _measured(
    runner: PairRunner, scans: Sequence[Scan], ends: np.ndarray, before: np.ndarray
) -> tuple[float, float] | None:
    """The share by which the sources' ranges are too long, with its standard deviation; None if it is too small.

    The pairs are registered again with sources that are shorter or longer by TRIED. The change of their estimates gives
    the response, by which the estimates before are divided.

    Args:
        ends: (P, 2) targets and sources.
        before: (P,) estimates of the sources' shares.
    """
    tried = float(np.sign(before.sum())) * TRIED
    targets, sources = (np.unique(own).tolist() for own in ends.T)
    beside = runner.beside([Change(factor=float(np.exp(-tried))).of(scans[k]) for k in sources], sources)
    changed = {k: len(scans) + n for n, k in enumerate(sources)}
    again = map(_longer, beside.register([Candidate(i, changed[k], "loop") for i, k in ends.tolist()]))
    both = [(share, after) for share, after in zip(before.tolist(), again, strict=True) if after is not None]
    share, after = np.array(both).reshape(-1, 2).T
    if len(both) < MIN_PAIRS or (response := float(np.mean(share - after)) / tried) <= 0:
        return None
    longer = float(np.mean(share)) / response
    scatter = max(float(np.std(share - longer / tried * (share - after), ddof=1)), MIN_SIGMA)
    sigma = scatter / response / min(len(targets), len(sources)) ** 0.5  # pairs of a scan share its errors
    if abs(longer) < max(MIN_SCALE, MIN_SIGMAS * sigma):
        return None
    return longer, float(np.hypot(sigma, SYSTEMATIC * longer))


def _longer(pair: RegisteredPair) -> float | None:
    """Share by which the source seems too long relative to the target; None if the pair does not show it."""
    registration = pair.registration
    if registration is None or not registration.accepted or registration.overlap < MIN_OVERLAP:
        return None
    stretch = dict(registration.evidence).get("stretch")
    return None if stretch is None else -stretch
