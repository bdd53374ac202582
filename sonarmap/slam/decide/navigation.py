# pyright: strict, reportMissingTypeStubs=false
"""What is measured beside a survey's scans: fixes of single poses, dead reckoning between them, control points."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from sonarmap.slam.decide.wrong_measurements import WrongFix, without_wrong_fixes
from sonarmap.slam.graph.control import ControlPoint
from sonarmap.slam.graph.edge import Edge, components
from sonarmap.slam.graph.place import place_in_world
from sonarmap.slam.graph.pose_graph import PoseGraph
from sonarmap.slam.graph.trajectory import chain
from sonarmap.slam.motion.odometry import Odometry
from sonarmap.spectral.scan import PosePrior, Scan


@dataclass(frozen=True, slots=True)
class Navigation:
    """Instruments, without fixes that they themselves contradict, and points that somebody surveyed.

    Attributes:
        scans: N, with the priors that are left; what is wrong must not bound a registration.
        odometry: the steps of dead reckoning.
        wrong_fixes: what dead reckoning and the other fixes contradict.
        control: points of scans with known coordinates; those to check with are not used.
    """

    scans: tuple[Scan, ...]
    odometry: tuple[Edge, ...] = ()
    wrong_fixes: tuple[WrongFix, ...] = ()
    control: tuple[ControlPoint, ...] = ()

    @classmethod
    def of(cls, scans: Sequence[Scan], surveys: np.ndarray, odometry: Odometry | None) -> "Navigation":
        """Of scans with their priors, and their dead reckoning, which shows wrong fixes before a scan is registered.

        Args:
            scans: N.
            surveys: (N,) the number of each scan's survey.
            odometry: None without.
        """
        if odometry is None:
            return cls(tuple(scans))
        steps, alone = odometry.edges(surveys), cls(tuple(scans))
        placed = place_in_world(chain(steps, alone.stamps), components(len(scans), steps), alone.priors)
        left, wrong = without_wrong_fixes(PoseGraph(placed, tuple(steps)), alone.priors)
        cleaned = tuple(replace(scan, prior=left.get(k)) for k, scan in enumerate(scans))
        return cls(cleaned, tuple(steps), wrong)

    def of_some(self, chosen: Sequence[int], odometry: Sequence[Edge]) -> "Navigation":
        """Of some of the scans, with the steps of dead reckoning between these; what is wrong has been left out."""
        number = {k: n for n, k in enumerate(chosen)}
        control = (replace(point, scan=number[point.scan]) for point in self.control if point.scan in number)
        return Navigation(tuple(self.scans[k] for k in chosen), tuple(odometry), control=tuple(control))

    @property
    def without_control(self) -> "Navigation":
        """The same without control points."""
        return replace(self, control=())

    @property
    def stamps(self) -> np.ndarray:
        """(N,) [s]."""
        return np.array([scan.stamp for scan in self.scans], dtype=np.float64)

    @property
    def priors(self) -> dict[int, PosePrior]:
        """By scan."""
        return {k: scan.prior for k, scan in enumerate(self.scans) if scan.prior is not None}
