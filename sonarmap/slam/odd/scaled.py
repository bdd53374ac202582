"""Scans from some scan on whose ranges are longer or shorter than those before, as by another speed of sound.

Registrations estimate only a part of the share by which a scan is too long, and this part differs between scenes. Their
estimates show where the ranges change; registrations with scans changed by a known share calibrate the estimates.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sonarmap.slam.execute.runner import PairRunner
from sonarmap.slam.odd.odd_scan import Change
from sonarmap.slam.pair import Candidate, RegisteredPair
from sonarmap.spectral.scan import Scan

MIN_SCALE = 0.01  # share of the ranges
MIN_SIGMAS = 5.0  # standard deviations by which the estimates of both groups, and the measured share, differ from 0
MIN_SCANS = 3  # of each group, in pairs between the groups
MAX_PAIRS = 10  # that are registered again
TRIED = 0.03  # share by which the later scans of these pairs are changed
SYSTEMATIC = 0.25  # relative standard deviation of the measured share, as responses are not linear


@dataclass(frozen=True, slots=True)
class ScaledScans:
    """A group of scans with other ranges than the rest."""

    scans: tuple[int, ...]  # the smaller group, ascending
    longer: float  # share by which its ranges are longer than those of the others, negative if shorter
    sigma: float  # standard deviation of that share


def find_scaled(runner: PairRunner, scans: Sequence[Scan], pairs: Sequence[RegisteredPair]) -> ScaledScans | None:
    """The first or last scans, if their ranges differ from the others' by 1 % or more; None otherwise.

    Args:
        runner: of the scans.
        pairs: accepted ones of one component, consecutive ones first.
    """
    shown = [(*pair.scans, share) for pair in pairs if (share := _longer(pair)) is not None]
    if not shown:
        return None
    ends, longer = np.array([scans_of[:2] for scans_of in shown]), np.array([share for *_, share in shown])
    first = _first_changed(ends, longer)
    across = np.flatnonzero((ends[:, 0] < first) & (ends[:, 1] >= first))[:MAX_PAIRS]
    measured = _measured(runner, scans, ends[across], longer[across]) if first else None
    if measured is None:
        return None
    before, after = (tuple(np.unique(ends[side]).tolist()) for side in (ends < first, ends >= first))
    share, sigma = measured
    return ScaledScans(after, share, sigma) if len(after) <= len(before) else ScaledScans(before, -share, sigma)


def _first_changed(ends: np.ndarray, longer: np.ndarray) -> int:
    """The first scan of the later group, if another scale of it explains the shares (P,) of pairs (P, 2) clearly
    best; else 0."""
    size = int(ends.max()) + 2

    def across(values: np.ndarray) -> np.ndarray:
        """Sums over the pairs across each scan: from a scan before it to it or a later one."""
        return np.cumsum(np.bincount(ends[:, 0] + 1, values, size) - np.bincount(ends[:, 1] + 1, values, size))

    explained = across(longer) ** 2 / np.maximum(across(np.ones(len(longer))), MIN_SCANS)
    first = int(np.argmax(explained))
    variance = (longer @ longer - explained[first]) / len(longer)
    return first if explained[first] > MIN_SIGMAS**2 * variance else 0


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
    sources = np.unique(ends[:, 1]).tolist()
    beside = runner.beside([Change(factor=float(np.exp(-tried))).of(scans[k]) for k in sources], sources)
    changed = {k: len(scans) + n for n, k in enumerate(sources)}
    again = map(_longer, beside.register([Candidate(i, changed[k], "loop") for i, k in ends.tolist()]))
    both = [(*pair, share, late) for pair, share, late in zip(ends, before, again, strict=True) if late is not None]
    targets, sources, share, after = np.array(both).reshape(-1, 4).T
    least = min(len(set(targets)), len(set(sources)))  # pairs of a scan share its errors
    if least < MIN_SCANS or (response := float(np.mean(share - after)) / tried) <= 0:
        return None
    longer = float(np.mean(share)) / response
    sigma = float(np.std(share - longer / tried * (share - after), ddof=1)) / response / least**0.5
    if abs(longer) < max(MIN_SCALE, MIN_SIGMAS * sigma):
        return None
    return longer, float(np.hypot(sigma, SYSTEMATIC * longer))


def _longer(pair: RegisteredPair) -> float | None:
    """Share by which the source seems too long relative to the target; None if the pair does not show it."""
    registration = pair.registration
    if registration is None or not registration.accepted:
        return None
    stretch = dict(registration.evidence).get("stretch")
    return None if stretch is None else -stretch
