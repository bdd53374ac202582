"""Places that registrations to several key scans of a map agree on, and scans located there."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import RigidTransform

from sonarmap.slam.candidates.settings import LoopSettings
from sonarmap.slam.graph.tangent import lengths, propagated, sigma_words

BOUND = LoopSettings().bound
_MAX_PROBABILITY = 0.999  # of a place, however many answers agree


@dataclass(frozen=True, slots=True)
class Place:
    """A pose that a scan may have in a map.

    Attributes:
        T_map_scan: p_map = T_map_scan p_scan [m].
        covariance: (6, 6), rotation first [rad, m], of xi in T_map_scan Exp(xi), the body tangent of the scan.
        probability: that the place is right, 0..1.
        keys: the map's key scans whose registrations agree on it.
        fixed: probability that no direction is unconstrained there, if it is right.
    """

    T_map_scan: RigidTransform
    covariance: np.ndarray
    probability: float
    keys: tuple[int, ...] = ()
    fixed: float = 1.0


def agreed_places(answers: Sequence[Place], floor: np.ndarray) -> list[Place]:
    """Merge the answers that agree into places, most probable first.

    Answers from different key scans that agree within their covariances count as independent. Of the places at most one
    is right, so their probabilities sum to less than 1: of two equally probable ones, neither has more than a half.

    Args:
        answers: each from one key scan.
        floor: (6,) standard deviations added to every answer [rad, m].
    """
    rest = sorted(answers, key=lambda answer: -answer.probability * answer.fixed)
    places: list[Place] = []
    while rest:
        agree = [lies_at(rest[0], answer, floor) for answer in rest]
        by_key: dict[int, float] = {}
        for answer, agrees in zip(rest, agree, strict=True):
            if agrees:
                by_key[answer.keys[0]] = max(by_key.get(answer.keys[0], 0.0), answer.probability)
        right = min(1.0 - float(np.prod([1.0 - p for p in by_key.values()])), _MAX_PROBABILITY)
        places.append(replace(rest[0], probability=right, keys=tuple(by_key)))
        rest = [answer for answer, agrees in zip(rest, agree, strict=True) if not agrees]
    odds = [place.probability / (1.0 - place.probability) for place in places]
    places = [replace(place, probability=odd / (1.0 + sum(odds))) for place, odd in zip(places, odds, strict=True)]
    return sorted(places, key=lambda place: -place.probability)


def lies_at(place: Place, other: Place, floor: np.ndarray) -> bool:
    """Whether two poses agree within their covariances and the (6,) standard deviations of the floor [rad, m]."""
    difference = place.T_map_scan.inv() * other.T_map_scan
    covariance = place.covariance + propagated(difference, other.covariance) + np.diag(floor**2)
    return bool(lengths(difference.as_exp_coords()[None], covariance[None])[0] <= BOUND)


@dataclass(frozen=True, slots=True)
class Located:
    """Where a scan was taken in a map.

    Attributes:
        name: of the scan.
        stamp: of the scan [s]; its number if it has no time.
        reason: why the place is accepted or not, in words.
        place: the most probable place, with the covariances of the registration and of the map's poses there; None if
            no key scan of the map resembles the scan.
        located: whether the place is accepted.
        psr: peak-to-sidelobe ratio of the registration to the map seen from the place; NaN without a place.
        overlap: share of points with a counterpart, scan in map or map in scan, the smaller one, 0..1.
        alternatives: other places, most probable first.
        tracked: whether it was located near the pose that the motion predicts, without a search of the whole map.
        seconds: computing time [s].
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
