# pyright: strict, reportMissingTypeStubs=false, reportUnknownMemberType=false
"""The scans between key scans, each registered to the key scan next to it, and to the other one where that is not
enough: like any pair, by the scans alone, and not about where a steady motion has them."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import RigidTransform
from scipy.special import chdtri

from sonarmap.slam.execute.runner import PairRunner
from sonarmap.slam.graph.edge import Edge
from sonarmap.slam.graph.tangent import lengths, propagated
from sonarmap.slam.pair import Candidate, RegisteredPair

# Two that say where a scan is agree where one of so many right ones is farther apart.
_AGREE = float(np.sqrt(chdtri(6, 1e-3)))


@dataclass(frozen=True, slots=True)
class Between:
    """A scan between two key scans."""

    scan: int
    step: Edge  # from the key scan before it: as a steady motion, or dead reckoning, has it
    after: int  # the key scan behind it
    T_keys: RigidTransform | None  # of the key scan behind it, in the frame of the one before; None where not known

    def candidates(self) -> tuple[Candidate, Candidate]:
        """The pairs with both key scans, that with the nearer one first."""
        sides = Candidate(self.step.i, self.scan, "sequential"), Candidate(self.scan, self.after, "sequential")
        return sides if self.scan - self.step.i <= self.after - self.scan else (sides[1], sides[0])


def refine(runner: PairRunner, scans: Sequence[Between], floor: np.ndarray) -> tuple[list[Edge], list[int]]:
    """How the scans lie to key scans: by registrations that can be believed, else as the steps have them.

    A registration that is accepted is believed where it agrees with the step, or with that to the other key scan.

    Args:
        runner: of all scans.
        floor: (6,) standard deviations that every two are granted between them [rad, m].

    Returns:
        Edges, and the scans that no registration holds.
    """
    first = {pair.scans: pair for pair in runner.register([each.candidates()[0] for each in scans])}
    agreed = {each.scan: _agreeing(each, first, floor) for each in scans}
    more = [each.candidates()[1] for each in scans if not agreed[each.scan]]
    both = first | {pair.scans: pair for pair in runner.register(more)}
    edges: list[Edge] = []
    left: list[int] = []
    for each in scans:
        found = agreed[each.scan] or _agreeing(each, both, floor)
        edges += found or [each.step]
        if not found:
            left.append(each.scan)
    return edges, left


def _agreeing(between: Between, registered: Mapping[tuple[int, int], RegisteredPair], floor: np.ndarray) -> list[Edge]:
    """The registrations of a scan that can be believed, none or one or both."""
    told = [(between.step.registration.T_target_source, between.step.registration.covariance)]
    edges: list[Edge] = []
    for candidate in between.candidates():
        pair = registered.get(candidate.scans)
        if pair is None or pair.registration is None or not pair.accepted:
            continue
        place = pair.registration.T_target_source, pair.registration.covariance
        if pair.i == between.scan:  # then of the key scan behind it, seen from here
            if between.T_keys is None:
                continue
            place = between.T_keys * place[0].inv(), propagated(*place)
        told.append(place)
        edges.append(Edge(*pair.scans, pair.registration, "sequential"))
    if len(edges) == 2 and _agree(told[1], told[2], floor):
        return edges
    return [edge for edge, place in zip(edges, told[1:], strict=True) if _agree(told[0], place, floor)][:1]


def _agree(one: tuple[RigidTransform, np.ndarray], other: tuple[RigidTransform, np.ndarray], floor: np.ndarray) -> bool:
    """Whether two that say where a scan is, with their covariances, body tangent, say the same."""
    away = np.asarray((one[0].inv() * other[0]).as_exp_coords())
    return bool(lengths(away[None], (one[1] + other[1] + np.diag(floor**2))[None])[0] <= _AGREE)
