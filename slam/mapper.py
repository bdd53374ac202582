"""The mapper: scans in, one consistent map out, on one screen."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from scipy.cluster.hierarchy import DisjointSet

from kernels.errors import InputError
from slam.decide.decision import Settlement, settle
from slam.execute.executor import Crew
from slam.execute.runner import PairRunner, Progress
from slam.graph.edge import Edge
from slam.graph.pose_covariance import pose_covariances
from slam.graph.pose_graph import Solution
from slam.graph.trajectory import Trajectory
from slam.loops.candidates import Candidate, LoopSettings, find_candidates, find_lookalikes
from slam.loops.forecast import outline
from slam.map.component_maps import ComponentMaps, component_maps
from slam.map.point_map import PointMap
from slam.pair import Pair, Trial, refuse_all_failed
from spectral.result import Registrar
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
        trajectory: N poses, each in the frame of its component, whose first pose is the identity; in the world
            (East-North-Up) where instruments measured any of its poses.
        chained: the same as they were before loops.
        components: the sets of scans that kept edges join; one where there is no gap.
        surveys: the number of each scan's survey.
        covariances: (N, 6, 6), rotation first [rad, m], body tangent, against the component's first pose, or the world.
        solution: the optimized graph, with its chi-squared and residuals.
        parts: the maps of every component.
        pairs: every pair that was tried, in the order of trying.
        gaps: consecutive pairs (i, i + 1) that were not kept, whether or not another pair bridges them.
        voxel: edge of the survey's voxels [m].
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

    @property
    def moved(self) -> float:
        """By how much loops moved the pose that they moved most, against its component's first [m]."""
        most = 0.0
        for members in self.components:
            before, after = (T.take(members).T_world_sensor for T in (self.chained, self.trajectory))
            apart = (before[0].inv() * before).translation - (after[0].inv() * after).translation
            most = max(most, float(np.linalg.norm(apart, axis=1).max()))
        return most

    @property
    def maps(self) -> tuple[PointMap, ...]:
        """The map of every component."""
        return tuple(part.optimized for part in self.parts)

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
        crew: who registers, with what the registrar is too; None for this process.

    Raises:
        InputError: a voxel that is not positive.
    """

    def __init__(
        self, registrar: Registrar, voxel: float, settings: MapperSettings | None = None, crew: Crew | None = None
    ) -> None:
        if not (np.isfinite(voxel) and voxel > 0):
            raise InputError(f"the survey's voxel is {voxel} m; wanted a positive length")
        self.registrar = registrar
        self.voxel = voxel
        self.settings = settings or MapperSettings()
        self.crew = crew

    def run(
        self, scans: Sequence[Scan], progress: Progress | None = None, surveys: Sequence[int] | None = None
    ) -> SurveyResult:
        """Map a survey, or several of one place.

        A pair that fails leaves a gap and the chain goes on behind it: a component of its own, unless other pairs
        join both sides.

        Args:
            scans: at least two, in the order in which they were taken, survey after survey.
            progress: called as progress(steps done, steps planned so far, words); the plan grows as
                candidates for bridges and loops are found.
            surveys: the number of each scan's survey, ascending; by default all are of one.

        Raises:
            InputError: fewer than two scans, or not one pair that could be tried.
        """
        if len(scans) < 2:
            raise InputError(f"{len(scans)} scan given; a map wants at least two that overlap")
        survey = np.zeros(len(scans), np.intp) if surveys is None else np.asarray(surveys, np.intp)
        runner = PairRunner(self.registrar, scans, self.settings.prepared, 2, progress, self.crew)

        trials = self._chain(runner, survey)
        trials += self._bridge(runner, trials, survey)
        refuse_all_failed(trials)
        settled = self._settle(runner, scans, trials)
        outlines = [outline(scan, self.settings.loops.cell_voxels * self.voxel) for scan in scans]
        for _ in range(self.settings.loops.rounds):
            # between parts no estimate tells which scans may overlap
            apart = len(settled.solution.graph.components) > 1
            signatures = runner.signatures() if apart else [None] * len(scans)
            candidates = self._candidates(outlines, signatures, settled, trials)
            runner.end_stage("candidates sought")
            if not candidates:
                break
            found = runner.register([(c.i, c.j) for c in candidates])
            trials += [
                Trial(c.i, c.j, "loop", attempt, c.overlap, c.alike)
                for c, attempt in zip(candidates, found, strict=True)
            ]
            settled = self._settle(runner, scans, trials)
        runner.forget()
        runner.tell("poses optimized")
        result = self._fuse(scans, survey, settled)
        runner.tell("map fused")
        return result

    def _chain(self, runner: PairRunner, survey: np.ndarray) -> list[Trial]:
        """Register consecutive scans of each survey."""
        wanted = [(k, k + 1) for k in range(len(survey) - 1) if survey[k] == survey[k + 1]]
        found = runner.register(wanted)
        return [Trial(*pair, "sequential", attempt) for pair, attempt in zip(wanted, found, strict=True)]

    def _bridge(self, runner: PairRunner, chained: Sequence[Trial], survey: np.ndarray) -> list[Trial]:
        """Try to join what the gaps part, shortest pairs first; nothing longer once a gap is bridged."""
        joined = DisjointSet(range(len(survey)))
        for trial in chained:
            if trial.accepted:
                joined.merge(trial.i, trial.j)
        gaps = [trial.i for trial in chained if not trial.accepted]
        tried: list[Trial] = []
        for span in range(2, self.settings.bridge + 1):
            across = dict.fromkeys(pair for gap in gaps for pair in _across(gap, span, survey))
            wanted = [pair for pair in across if not joined.connected(*pair)]
            for pair, attempt in zip(wanted, runner.register(wanted), strict=True):
                tried.append(Trial(*pair, "bridge", attempt))
                if tried[-1].accepted:
                    joined.merge(*pair)
        return tried

    def _settle(self, runner: PairRunner, scans: Sequence[Scan], trials: Sequence[Trial]) -> Settlement:
        stamps = np.array([scan.stamp for scan in scans], dtype=np.float64)
        priors = {k: scan.prior for k, scan in enumerate(scans) if scan.prior is not None}
        settled = settle(trials, stamps, priors, self.voxel, self.settings.loops)
        runner.end_stage("poses optimized")
        return settled

    def _candidates(
        self,
        outlines: Sequence[np.ndarray],
        signatures: Sequence[np.ndarray | None],
        settled: Settlement,
        trials: Sequence[Trial],
    ) -> list[Candidate]:
        """Pairs to try next, in the order of the scans: neighbors in that order share prepared scans."""
        tried, loops = {(trial.i, trial.j) for trial in trials}, self.settings.loops
        found = find_candidates(outlines, settled.solution, self.voxel, loops, tried)
        found += find_lookalikes(signatures, settled.solution.graph.components, loops, tried)
        return sorted(found, key=lambda candidate: (candidate.i, candidate.j))

    def _fuse(self, scans: Sequence[Scan], survey: np.ndarray, settled: Settlement) -> SurveyResult:
        solution, covariances = settled.solution, pose_covariances(settled.solution)
        trajectory, components = solution.trajectory, solution.graph.components
        parts = tuple(
            component_maps(
                [scans[k] for k in members],
                settled.chained.take(members),
                trajectory.take(members),
                covariances[list(members)],
                self.settings.map_voxel or self.voxel,
                members,
                survey[list(members)].tolist(),
            )
            for members in components
        )
        return SurveyResult(
            trajectory=trajectory,
            chained=settled.chained,
            components=components,
            surveys=tuple(survey.tolist()),
            covariances=covariances,
            solution=solution,
            parts=parts,
            pairs=settled.pairs,
            gaps=tuple((pair.i, pair.j) for pair in settled.pairs if pair.role == "sequential" and not pair.kept),
            voxel=self.voxel,
        )


def _across(gap: int, span: int, survey: np.ndarray) -> list[tuple[int, int]]:
    """Pairs of one survey, `span` scans apart, with the gap (gap, gap + 1) between them."""
    firsts = [i for i in range(gap, gap - span, -1) if i >= 0 and i + span < len(survey)]
    return [(i, i + span) for i in firsts if survey[i] == survey[i + span]]
