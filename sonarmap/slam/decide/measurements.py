"""The measurements of a survey beside registrations: fixes, dead reckoning, control points, and ties."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from sonarmap.slam.decide.wrong_measurements import KINDS, NOTHING, without_kinds
from sonarmap.slam.graph.control import ControlPoint
from sonarmap.slam.graph.edge import Edge
from sonarmap.slam.motion.odometry import Odometry
from sonarmap.slam.tie import Tie
from sonarmap.spectral.scan import PosePrior, Scan


@dataclass(frozen=True, slots=True)
class Measurements:
    """Scans, measurements of instruments, which may be wrong, and a person's ties and control points."""

    scans: tuple[Scan, ...]  # N, with their priors
    surveys: np.ndarray  # (N,) the number of each scan's survey
    odometry: Odometry | None = None  # dead reckoning; None without
    control: tuple[ControlPoint, ...] = ()  # points of scans with known coordinates; check points are not used
    # by the scans of their pairs
    ties: Mapping[tuple[int, int], Tie] = field(default_factory=dict[tuple[int, int], Tie])

    def searched(self, understated: Mapping[str, float] | None = None) -> tuple[Scan, ...]:
        """The scans as they are registered: without positions, as a search that they bound could not contradict them,
        with larger sigmas of the `understated` kinds, by their ratio of actual to stated errors, and without kinds
        whose errors say nothing."""
        useless = {kind for kind, ratio in (understated or {}).items() if ratio >= NOTHING}

        def bounding(prior: PosePrior | None) -> PosePrior | None:
            if prior is None or (without := without_kinds(prior, {"position", *useless})) is None:
                return None
            sigmas = without.sigmas.copy()
            for kind, ratio in (understated or {}).items():
                sigmas[KINDS[kind]] *= ratio
            return replace(without, sigmas=sigmas)

        return tuple(replace(scan, prior=bounding(scan.prior)) for scan in self.scans)

    def take(self, chosen: Sequence[int]) -> "Measurements":
        """Only these scans, ascending and numbered 0, 1, ...

        Raises:
            InputError: a tie of another scan.
        """
        number, names = {k: n for n, k in enumerate(chosen)}, [scan.name for scan in self.scans]
        ties = [tie.renumbered(number, names) for tie in self.ties.values()]
        return Measurements(
            tuple(self.scans[k] for k in chosen),
            self.surveys[list(chosen)],
            None if self.odometry is None else self.odometry.take(chosen),
            control=tuple(replace(point, scan=number[point.scan]) for point in self.control if point.scan in number),
            ties={tie.scans: tie for tie in ties},
        )

    @property
    def by_instruments(self) -> "Measurements":
        """The same without control points and ties."""
        return replace(self, control=(), ties={})

    @property
    def steps(self) -> list[Edge]:
        """Edges of dead reckoning, within each survey."""
        return [] if self.odometry is None else self.odometry.edges(self.surveys)

    @property
    def runs(self) -> np.ndarray:
        """(N,) numbers of the runs in which consecutive scans are registered: the surveys, or single scans where dead
        reckoning alone gives the steps."""
        if self.odometry is None or not self.odometry.alone:
            return self.surveys
        apart = ~np.isin(np.arange(len(self.surveys)), self.odometry.scans[1:])
        return np.cumsum(~apart | np.append(True, np.diff(self.surveys) != 0)) - 1

    @property
    def stamps(self) -> np.ndarray:
        """(N,) [s]."""
        return np.array([scan.stamp for scan in self.scans], dtype=np.float64)

    @property
    def priors(self) -> dict[int, PosePrior]:
        """Measurements of instruments, by scan."""
        return {k: scan.prior for k, scan in enumerate(self.scans) if scan.prior is not None}
