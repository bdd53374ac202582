"""Answers of registrations to several key scans of a map, and the places that they agree on."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import RigidTransform

from sonarmap.slam.candidates.settings import LoopSettings
from sonarmap.slam.graph.tangent import lengths, propagated

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
