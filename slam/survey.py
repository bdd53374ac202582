"""The mapper: scans in, one consistent map out, on one screen."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.cluster.hierarchy import DisjointSet

from kernels.errors import InputError
from slam.edge import Edge
from slam.loop_closure import LoopSettings, find_candidates, judge
from slam.pair import Pair, PairRunner, Progress, refuse_all_failed, weigh
from slam.point_map import PointMap, fuse
from slam.pose_graph import PoseGraph, Solution
from slam.trajectory import Trajectory, chain
from spectral.result import Registrar, Registration
from spectral.scan import Scan


@dataclass(frozen=True, slots=True)
class MapperSettings:
    """How a survey is put together.

    Attributes:
        loops: which extra pairs are tried and kept.
        bridge: over a gap, pairs up to this many scans apart are tried; 1 tries none.
        prepared: number of prepared scans kept at a time; each holds device memory.
        map_voxel: edge of the fused map's voxels [m]; None is the survey's voxel.
    """

    loops: LoopSettings = field(default_factory=LoopSettings)
    bridge: int = 3
    prepared: int = 4
    map_voxel: float | None = None

    def __post_init__(self) -> None:
        if self.bridge < 1 or self.prepared < 2:
            raise InputError(
                f"bridge is {self.bridge} and prepared is {self.prepared}; wanted at least 1 and at least 2"
            )
        if self.map_voxel is not None and not (np.isfinite(self.map_voxel) and self.map_voxel > 0):
            raise InputError(f"the map's voxel is {self.map_voxel} m; wanted a positive length")


@dataclass(frozen=True, slots=True)
class SurveyResult:
    """A survey, mapped.

    Attributes:
        trajectory: N poses, each in the frame of its component, whose first pose is the identity.
        components: the sets of scans that kept edges join; one where there is no gap.
        covariances: (N, 6, 6), rotation first [rad, m], body tangent, against the component's first pose.
        solution: the optimized graph, with its chi-squared and residuals.
        maps: one for every component.
        pairs: every pair that was tried, in the order of trying.
        gaps: consecutive pairs (i, i + 1) that were not kept, whether or not another pair bridges them.
    """

    trajectory: Trajectory
    components: tuple[tuple[int, ...], ...]
    covariances: np.ndarray
    solution: Solution
    maps: tuple[PointMap, ...]
    pairs: tuple[Pair, ...]
    gaps: tuple[tuple[int, int], ...]

    @property
    def edges(self) -> tuple[Edge, ...]:
        """What the graph was built from."""
        return self.solution.graph.edges


class Mapper:
    """Registers a survey's scans and fuses them into a map.

    Args:
        registrar: any method of registration.
        voxel: edge of the survey's voxels [m].
        settings: everything else.

    Raises:
        InputError: a voxel that is not positive.
    """

    def __init__(self, registrar: Registrar, voxel: float, settings: MapperSettings | None = None) -> None:
        if not (np.isfinite(voxel) and voxel > 0):
            raise InputError(f"the survey's voxel is {voxel} m; wanted a positive length")
        self.registrar = registrar
        self.voxel = voxel
        self.settings = settings or MapperSettings()

    def run(self, scans: Sequence[Scan], progress: Progress | None = None) -> SurveyResult:
        """Map a survey.

        A pair that fails leaves a gap and the chain goes on behind it: a component of its own, unless a pair over
        the gap joins both sides.

        Args:
            scans: at least two, in the order in which they were taken.
            progress: called as progress(steps done, steps planned so far, words); the plan grows as
                candidates for bridges and loops are found.

        Raises:
            InputError: fewer than two scans, or not one pair that could be tried.
        """
        if len(scans) < 2:
            raise InputError(f"{len(scans)} scan given; a map wants at least two that overlap")
        stamps = np.array([scan.stamp for scan in scans], dtype=np.float64)
        runner = PairRunner(self.registrar, scans, self.settings.prepared, 2, progress)

        wanted = [(k, k + 1) for k in range(len(scans) - 1)]
        pairs = [weigh(*pair, "sequential", found) for pair, found in zip(wanted, runner.register(wanted), strict=True)]
        pairs += self._bridge(runner, pairs, len(scans))
        refuse_all_failed(pairs)
        edges = _edges(pairs)
        solution = PoseGraph(chain(edges, stamps), edges).optimize()

        pairs += self._close_loops(runner, scans, solution)
        runner.forget()
        solution = PoseGraph(solution.trajectory, _edges(pairs)).optimize()
        runner.tell("poses optimized")
        result = self._fuse(scans, solution, pairs)
        runner.tell("map fused")
        return result

    def _bridge(self, runner: PairRunner, chained: Sequence[Pair], count: int) -> list[Pair]:
        """Try to join what the gaps part, shortest pairs first; nothing longer once a gap is bridged."""
        joined = DisjointSet(range(count))
        for pair in chained:
            if pair.kept:
                joined.merge(pair.i, pair.j)
        gaps = [pair.i for pair in chained if not pair.kept]
        tried: list[Pair] = []
        for span in range(2, self.settings.bridge + 1):
            across = dict.fromkeys(pair for gap in gaps for pair in _across(gap, span, count))
            wanted = [pair for pair in across if not joined.connected(*pair)]
            for pair, found in zip(wanted, runner.register(wanted), strict=True):
                tried.append(weigh(*pair, "bridge", found))
                if tried[-1].kept:
                    joined.merge(*pair)
        return tried

    def _close_loops(self, runner: PairRunner, scans: Sequence[Scan], solution: Solution) -> list[Pair]:
        """Register the pairs that the estimate says overlap, and keep those that agree with it."""
        # In the order of the scans, not of promise: neighbors in that order share prepared scans.
        candidates = sorted(
            find_candidates(scans, solution, self.voxel, self.settings.loops), key=lambda found: (found.i, found.j)
        )
        pairs = []
        for candidate, found in zip(candidates, runner.register([(c.i, c.j) for c in candidates]), strict=True):

            def verdict(registration: Registration, candidate=candidate):
                return judge(candidate, registration, solution, self.voxel, self.settings.loops)

            pairs.append(weigh(candidate.i, candidate.j, "loop", found, verdict, candidate.overlap))
        return pairs

    def _fuse(self, scans: Sequence[Scan], solution: Solution, pairs: Sequence[Pair]) -> SurveyResult:
        trajectory, components = solution.trajectory, solution.graph.components
        voxel = self.settings.map_voxel or self.voxel
        maps = tuple(
            fuse([scans[k] for k in members], trajectory.take(members).T_world_sensor, voxel, members)
            for members in components
        )
        residuals = iter(solution.residuals.tolist())
        return SurveyResult(
            trajectory=trajectory,
            components=components,
            covariances=solution.covariances(),
            solution=solution,
            maps=maps,
            pairs=tuple(replace(pair, residual=next(residuals)) if pair.kept else pair for pair in pairs),
            gaps=tuple((pair.i, pair.j) for pair in pairs if pair.role == "sequential" and not pair.kept),
        )


def _edges(pairs: Sequence[Pair]) -> tuple[Edge, ...]:
    return tuple(pair.edge for pair in pairs if pair.edge is not None)


def _across(gap: int, span: int, count: int) -> list[tuple[int, int]]:
    """Pairs `span` scans apart with the gap (gap, gap + 1) between them."""
    return [(i, i + span) for i in range(gap, gap - span, -1) if i >= 0 and i + span < count]
