"""The result of mapping a survey: poses, covariances, maps, and every pair that was tried."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np
from scipy.cluster.hierarchy import DisjointSet

from sonarmap.kernels.counted import counted
from sonarmap.slam.decide.other_place import OtherPlace
from sonarmap.slam.decide.systematic import Systematic
from sonarmap.slam.decide.wrong_measurements import KINDS, NOTHING, WrongFix, agreement
from sonarmap.slam.graph.control import MeasuredControl
from sonarmap.slam.graph.edge import Edge
from sonarmap.slam.graph.pose_graph import Solution
from sonarmap.slam.graph.tangent import sigma_words
from sonarmap.slam.graph.trajectory import Trajectory
from sonarmap.slam.map.doubtful_points import ComponentMaps
from sonarmap.slam.map.point_map import PointMap
from sonarmap.slam.motion.straighten import Way
from sonarmap.slam.odd.odd_scan import OddScan
from sonarmap.slam.odd.scaled import ScaledScans
from sonarmap.slam.pair import Pair
from sonarmap.slam.parts import placed
from sonarmap.slam.tie import Tie

DISPUTED = 3.0  # median error of instruments from which they contradict the map [sigmas]
_REJECTED_SHARE = 0.5  # of the accepted pairs, above which instruments contradict the map too,
_CHANCE = 0.01  # if all rejected pairs are wrong with at most this probability


@dataclass(frozen=True, slots=True)
class SurveyResult:
    """A survey, mapped.

    Attributes:
        trajectory: N poses, each in the frame of its component, whose first pose is the identity; in the world
            (East-North-Up) where instruments measured any of its poses.
        chained: the poses before loops.
        components: the sets of scans that share a frame, by kept edges or by instruments that place them in the world.
        surveys: the number of each scan's survey.
        keys: the key scans of a dense stream, ascending; None where every scan was registered.
        interpolated: scans between key scans that no registration holds, placed by the motion alone.
        other_places: parts of the map that other pairs place elsewhere with about as much evidence.
        straightened: by how much [m] all but a few points of each scan were moved to correct the sensor's motion; None
            if no scan was.
        way: the motion by which they were corrected.
        wrong_fixes: measurements of instruments that were left out, as all others contradict them.
        understated: ratio of actual to stated errors, by kind of `slam.decide.wrong_measurements` or "odometry"; kinds
            with a ratio of NOTHING or more were left out.
        mistake: a mistake that explains why instruments contradict the map, and its remedy, in words; "" for none.
        systematic: an error that all fixes share, which was removed from them; None for none.
        covariances: (N, 6, 6), rotation first [rad, m], body tangent, relative to the component's first pose or the
            world.
        solution: the optimized graph, with its chi-squared and residuals.
        parts: the maps of every component.
        pairs: every pair that was tried, in the order of trying.
        gaps: consecutive pairs (i, i + 1) that were not kept, whether or not another pair bridges them.
        voxel: edge of the survey's voxels [m].
        ties: a person's verdicts on pairs; their outcome is in `pairs`.
        control: control and check points with their coordinates in the map.
        odd: faulty scans, which are mirrored or in another unit and are in no map.
        scaled: scans whose ranges are longer or shorter than those of the others; None for none.
        names: of the N scans.
    """

    trajectory: Trajectory
    chained: Trajectory
    components: tuple[tuple[int, ...], ...]
    surveys: tuple[int, ...]
    covariances: np.ndarray
    solution: Solution
    parts: tuple[ComponentMaps, ...]
    pairs: tuple[Pair, ...]
    gaps: tuple[tuple[int, int], ...]
    voxel: float
    wrong_fixes: tuple[WrongFix, ...] = ()
    understated: Mapping[str, float] = field(default_factory=dict[str, float])
    mistake: str = ""
    systematic: Systematic | None = None
    keys: tuple[int, ...] | None = None
    interpolated: tuple[int, ...] = ()
    other_places: tuple[OtherPlace, ...] = ()
    straightened: tuple[float, ...] | None = None
    way: Way | None = None
    ties: tuple[Tie, ...] = ()
    control: tuple[MeasuredControl, ...] = ()
    odd: tuple[OddScan, ...] = ()
    scaled: ScaledScans | None = None
    names: tuple[str, ...] = ()

    def __str__(self) -> str:
        maps, loops = placed(self.components), [pair.kept for pair in self.pairs if pair.role == "loop"]
        inside = sum(len(self.components[c]) for c in maps)
        points = counted(sum(len(self.maps[c].points) for c in maps), "point")
        moved = f", which moved poses by up to {self.moved:.2g} m" if any(loops) else ""
        return (
            f"{inside} of {counted(len(self.trajectory), 'scan')} placed in {counted(len(maps), 'map')}: {points}, "
            f"voxels of {self.maps[maps[0]].voxel:.3g} m\n"
            f"  {sum(pair.kept for pair in self.pairs)} of {counted(len(self.pairs), 'pair')} kept, "
            f"{sum(loops)} of {counted(len(loops), 'loop')}{moved}\n"
            f"  poses' sigmas up to {sigma_words(self.covariances)}"
        )

    @property
    def moved(self) -> float:
        """Largest displacement of a pose by loops, relative to its component's first pose [m]."""
        return max(self.trajectory.take(each).farthest_from(self.chained.take(each)) for each in self.components)

    @property
    def agreement(self) -> dict[str, tuple[int, int, float]]:
        """By kind of instruments' measurements: number used, number of all, and median distance from the poses
        [sigmas]."""
        return agreement(dict(self.solution.graph.priors), self.wrong_fixes, self.trajectory.T_world_sensor)

    @property
    def unclear(self) -> bool:
        """Whether the fixes' common error has two explanations, which place the map differently."""
        return self.systematic is not None and self.systematic.alternative is not None

    @property
    def contradicted(self) -> tuple[str, ...]:
        """The kinds of measurements that were left out as a whole."""
        return tuple(kind for kind, times in self.understated.items() if kind in KINDS and times >= NOTHING)

    @property
    def disputed(self) -> dict[str, float]:
        """Median error in stated standard deviations, by kind of measurement that the map contradicts."""
        apart = {kind: sigmas for kind, (_, _, sigmas) in self.agreement.items()}
        apart |= {kind: times for kind, times in self.understated.items() if kind in KINDS}
        return {kind: sigmas for kind, sigmas in apart.items() if sigmas >= DISPUTED}

    @property
    def refused_for_navigation(self) -> tuple[int, int]:
        """Numbers of rejected and of all accepted pairs, if instruments take part and more pairs are rejected than can
        be wrong by their own probabilities; (0, 0) else."""
        accepted = [pair for pair in self.pairs if pair.accepted]
        rejected = [pair for pair in accepted if not pair.kept]
        all_wrong = math.prod(1 - pair.registration.probability for pair in rejected if pair.registration is not None)
        if not self.solution.graph.priors or len(rejected) <= _REJECTED_SHARE * len(accepted) or all_wrong > _CHANCE:
            return 0, 0
        return len(rejected), len(accepted)

    @property
    def by_navigation(self) -> tuple[int, ...]:
        """Scans that no registration holds, and that navigation alone places in a map of several scans."""
        held = {scan for edge in self.edges for scan in (edge.i, edge.j)}
        free = set(range(len(self.trajectory)) if self.keys is None else self.keys) - held
        return tuple(sorted(k for members in self.components if len(members) > 1 for k in free.intersection(members)))

    @property
    def unconfirmed(self) -> tuple[Pair, ...]:
        """Gaps whose sides are in one map only by pairs that were sought at expected poses,
        where such pairs are found, rightly or not."""
        graph = self.solution.graph
        sought = {pair.scans for pair in self.pairs if pair.expected is not None and pair.role != "sequential"}
        joined = DisjointSet(range(len(self.trajectory)))
        for edge in graph.edges:
            if edge.kind != "prior" and (edge.i, edge.j) not in sought:
                joined.merge(edge.i, edge.j)
        for one, other in pairwise(graph.gauge.in_world):
            joined.merge(one, other)
        part = {k: n for n, members in enumerate(self.components) for k in members}
        steps = (pair for pair in self.pairs if pair.role == "sequential" and part[pair.i] == part[pair.j])
        return tuple(step for step in steps if not joined.connected(*step.scans))

    @property
    def maps(self) -> tuple[PointMap, ...]:
        return tuple(part.optimized for part in self.parts)

    @property
    def edges(self) -> tuple[Edge, ...]:
        """The registrations that the graph was built from, and the ties that a person measured."""
        return tuple(edge for edge in self.solution.graph.edges if edge.is_of_pair)
