# pyright: strict, reportMissingTypeStubs=false, reportUnknownMemberType=false
# pyright: reportUnknownVariableType=false, reportUnknownArgumentType=false
"""A new map brought onto an old one: views of it are located there, and those that agree on one transform count."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import RigidTransform

from sonarmap.slam.graph.tangent import lengths, propagated
from sonarmap.slam.locate.locator import Locator
from sonarmap.slam.locate.surveyed_map import SurveyedMap
from sonarmap.spectral.scan import Scan

MOST_VIEWS = 16  # of the new map, spread over its track
FEWEST = 2  # that have to agree, unless the map has a single one
_BOUND = 4.74  # [sigmas], as `slam.locate.place` has it
_ROUNDS = 5


@dataclass(frozen=True, slots=True)
class Alignment:
    """How the new map lies in the old one."""

    T_old_new: RigidTransform  # p_old = T_old_new p_new [m]
    covariance: np.ndarray  # (6, 6) rotation first [rad, m], left tangent: T_true = Exp(xi) T_old_new
    located: int  # views of the new map that were located in the old one
    agreeing: int  # of these, how many agree with the transform
    tried: int

    @property
    def inverse(self) -> "Alignment":
        """How the old map lies in the new one, the views being of whichever they are."""
        T = self.T_old_new.inv()
        return replace(self, T_old_new=T, covariance=propagated(T, self.covariance))


def located_views(
    locator: Locator, new: SurveyedMap, step: Callable[[int, int, str], None]
) -> tuple[list[tuple[RigidTransform, np.ndarray]], int]:
    """Where views of the new map lie in the old one: T_old_new of each that is believed, with its (6, 6) covariance
    [rad, m] as a left tangent; and how many were tried."""
    apart = new.apart
    keys = [apart[k] for k in np.unique(np.linspace(0, len(apart) - 1, MOST_VIEWS).round().astype(int)).tolist()]
    answers: list[tuple[RigidTransform, np.ndarray]] = []
    for done, key in enumerate(keys):
        step(done, len(keys), f"view {key}")
        T_new_view = new.T_map_sensor[key]
        found = locator.locate(Scan(new.seen_from(T_new_view, new.view_of(key)), name=f"view {key}"))
        if found.located:
            in_body = found.covariance + new.covariances[key]
            answers.append((found.T_map_scan * T_new_view.inv(), propagated(found.T_map_scan, in_body)))
    step(len(keys), len(keys), "")
    return answers, len(keys)


def agreed(answers: list[tuple[RigidTransform, np.ndarray]], tried: int) -> Alignment | None:
    """The transform on which most answers agree; None where too few do.

    Its covariance is that of a single answer of those that agree, about the median one: what keeps answers apart, the
    poses of both maps, they partly share, so that it does not average out.
    """
    if not answers:
        return None
    T = RigidTransform.concatenate([each for each, _ in answers])
    C = np.array([each for _, each in answers])
    counts = [int((_apart(T[k], C[k], T, C) <= _BOUND).sum()) for k in range(len(answers))]
    best = int(np.argmax(counts))
    inside = _apart(T[best], C[best], T, C) <= _BOUND
    if inside.sum() < min(FEWEST, tried) or 2 * inside.sum() <= len(answers):
        return None
    mean: RigidTransform = T[best]
    information = np.linalg.inv(C[inside])
    total = information.sum(axis=0)
    for _ in range(_ROUNDS):
        xi = (T[inside] * mean.inv()).as_exp_coords()
        mean = RigidTransform.from_exp_coords(np.linalg.solve(total, np.einsum("nab,nb->a", information, xi))) * mean
    return Alignment(mean, len(information) * np.linalg.inv(total), len(answers), int(inside.sum()), tried)


def _apart(T: RigidTransform, C: np.ndarray, others: RigidTransform, covariances: np.ndarray) -> np.ndarray:
    """(n,) how far other transforms are from one [sigmas]."""
    return lengths((others * T.inv()).as_exp_coords(), covariances + C)
