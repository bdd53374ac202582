"""Answers of registrations to several key scans of a map, the places that they agree on, and scans located there."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import RigidTransform

from sonarmap.slam.candidates.settings import LoopSettings
from sonarmap.slam.graph.tangent import lengths, propagated, sigma_words

BOUND = LoopSettings().bound
_SUREST = 0.999  # no place is more probable by what agrees


@dataclass(frozen=True, slots=True)
class Place:
    """A pose that a scan may have in a map.

    Attributes:
        T_map_scan: p_map = T_map_scan p_scan [m].
        covariance: (6, 6), rotation first [rad, m], of xi in T_map_scan Exp(xi), the body tangent of the scan.
        probability: that it is right, 0..1.
        keys: the map's key scans whose answers name it.
        fixed: the probability that no direction is open there, where it is right.
    """

    T_map_scan: RigidTransform
    covariance: np.ndarray
    probability: float
    keys: tuple[int, ...] = ()
    fixed: float = 1.0


def agreed_places(answers: Sequence[Place], floor: np.ndarray) -> list[Place]:
    """The places that answers name, most probable first, each with the probability that all of them leave it.

    Answers to several key scans that agree within their covariances count as independent. Of places that contradict one
    another at most one is right, so they share what is left: where two are as probable, neither has more than a half.

    Args:
        answers: each of one key scan.
        floor: (6,) standard deviations that every answer is granted [rad, m].
    """
    left = sorted(answers, key=lambda answer: -answer.probability * answer.fixed)
    places: list[Place] = []
    while left:
        agree = [lies_at(left[0], answer, floor) for answer in left]
        by_key: dict[int, float] = {}
        for answer, agrees in zip(left, agree, strict=True):
            if agrees:
                by_key[answer.keys[0]] = max(by_key.get(answer.keys[0], 0.0), answer.probability)
        right = min(1.0 - float(np.prod([1.0 - p for p in by_key.values()])), _SUREST)
        places.append(replace(left[0], probability=right, keys=tuple(by_key)))
        left = [answer for answer, agrees in zip(left, agree, strict=True) if not agrees]
    odds = [place.probability / (1.0 - place.probability) for place in places]
    together = [replace(each, probability=odd / (1.0 + sum(odds))) for each, odd in zip(places, odds, strict=True)]
    return sorted(together, key=lambda place: -place.probability)


def lies_at(place: Place, other: Place, floor: np.ndarray) -> bool:
    """Whether two poses agree within their covariances and the (6,) standard deviations [rad, m] that are granted."""
    apart = place.T_map_scan.inv() * other.T_map_scan
    covariance = place.covariance + propagated(apart, other.covariance) + np.diag(floor**2)
    return bool(lengths(apart.as_exp_coords()[None], covariance[None])[0] <= BOUND)


@dataclass(frozen=True, slots=True)
class Located:
    """Where a scan was taken in a map.

    Attributes:
        name: of the scan.
        stamp: of the scan [s], or its number where there is no time.
        reason: in words, why the place is believed or not.
        place: the most probable one. Its covariance holds what the scan leaves open against the map, and what the map
            does of its own poses there. None where nothing of the map is like the scan.
        located: whether to believe it.
        psr: peak-to-sidelobe ratio of the registration to the map as it is seen from there; NaN without a place.
        overlap: the share of points with a counterpart in the map seen from there, 0..1, the smaller of both ways.
        alternatives: other places, most probable first.
        tracked: whether it was sought about where the motion expected it, and not in the whole map.
        seconds: time of the scan [s].
    """

    name: str
    stamp: float
    reason: str
    place: Place | None = None
    located: bool = False
    psr: float = math.nan
    overlap: float = 0.0
    alternatives: tuple[Place, ...] = ()
    tracked: bool = False
    seconds: float = 0.0

    @property
    def T_map_scan(self) -> RigidTransform:
        """p_map = T_map_scan p_scan [m]; the identity without a place."""
        return RigidTransform.identity() if self.place is None else self.place.T_map_scan

    @property
    def covariance(self) -> np.ndarray:
        """(6, 6), rotation first [rad, m], of xi in T_map_scan Exp(xi); infinite along the diagonal without a place."""
        return np.diag(np.full(6, np.inf)) if self.place is None else self.place.covariance

    @property
    def probability(self) -> float:
        return 0.0 if self.place is None else self.place.probability

    def __str__(self) -> str:
        verdict = f"{self.name}: {'located' if self.located else 'NOT LOCATED'}, probability {self.probability:.1%}"
        if self.place is None:
            return f"{verdict}\n  {self.reason}"
        x, y, z = self.T_map_scan.translation.tolist()
        sigmas = sigma_words(self.covariance)
        return f"{verdict}\n  at x {x:.3f}, y {y:.3f}, z {z:.3f} m of the map, sigmas {sigmas}\n  {self.reason}"
