"""A survey mapped by one system, in a process of its own, so that its memory is the system's alone."""

from collections.abc import Sequence
from dataclasses import dataclass
from time import perf_counter
from typing import TYPE_CHECKING

import numpy as np

from sonarmap.kernels.errors import InputError
from sonarmap.slam.execute.processes import spawned
from sonarmap.slam.graph.trajectory import Trajectory
from sonarmap.spectral.scan import Scan
from sonarmap.tools.files.map_folder.pairs import TriedPair

if TYPE_CHECKING:
    from sonarmap.slam.execute.worker import Job, Sources, TimedText, Worker
    from sonarmap.slam.pair import Pair
    from sonarmap.slam.survey_result import SurveyResult
    from sonarmap.spectral.grid import Grid
    from sonarmap.spectral.registration import SpectralRegistrar
    from sonarmap.tools.lab.baselines.surveys import SlamRun

OURS = "sonarmap"
PEERS = ("multiway", "kiss-slam")
SYSTEMS = (OURS, *PEERS)


@dataclass(frozen=True, slots=True)
class Crossings:
    """How far passes over one place lie apart, the median of their medians [m], before and after the loops."""

    before: float = float("nan")
    after: float = float("nan")


@dataclass(frozen=True, slots=True)
class MappingTime:
    """How long a system took, and its memory."""

    total: float  # wall time from the first scan to the last result [s]
    memory: int  # the most that its process had resident [bytes]
    # registering, signing, optimizing, fusing: of it; optimizing is all the rest, with the choice of loops [s]
    registering: float = float("nan")
    signing: float = float("nan")
    optimizing: float = float("nan")
    fusing: float = float("nan")


@dataclass(frozen=True, slots=True)
class MappedSurvey:
    """What a system made of a survey."""

    placed: tuple[int, ...]  # the scans of its largest component, ascending
    components: int  # how many have two scans or more
    trajectory: Trajectory  # the poses of the placed scans, in a frame of their own; stamps count the survey's scans
    chained: Trajectory | None  # the same before loops; None of a system that does not tell
    # (n, 6, 6) of the poses against the first of them, rotation first [rad, m], body tangent; None likewise
    covariances: np.ndarray | None
    pairs: tuple[TriedPair, ...]  # all that were tried, as the scans' numbers
    points: np.ndarray  # (M, 3) [m], of the map in the trajectory's frame
    seen: np.ndarray  # (M,) int, how many scans saw each
    crossings: Crossings  # of the passes
    signatures: dict[int, np.ndarray]  # by scan, of those that have one
    time: MappingTime  # time and memory


def map_survey(
    system: str, scans: Sequence[Scan], surveys: Sequence[int], grid: "Grid", device: str | None
) -> MappedSurvey:
    """Map a survey in a new process.

    Args:
        system: one of SYSTEMS.
        scans: in their order, with stamps that count them from 0.
        surveys: the number of each scan's survey, ascending.
        grid: of the registrations; of other systems' the voxel alone.
        device: as `choose_device` takes it.

    Raises:
        InputError, DeviceError: the scans, the package or the device will not do.
    """
    with spawned(1) as pool:
        if system == OURS:
            return pool.submit(_ours, scans, surveys, grid, device).result()
        return pool.submit(_peer, system, scans, grid).result()


def installed(system: str) -> bool:
    """Whether a system's package is there, where it needs one."""
    from sonarmap.tools.extras import load_package

    if system != "kiss-slam":
        return True
    try:
        load_package("kiss_slam.slam", "kiss-slam", "the method kiss-slam", "slam-peers")
    except InputError:
        return False
    return True


class _TimedWorker:
    """A worker whose time is taken [s]."""

    def __init__(self, worker: "Worker") -> None:
        self._worker = worker
        self.registering = self.signing = 0.0

    def run(self, jobs: "Sequence[Job]", sources: "Sources") -> "list[TimedText]":
        from sonarmap.slam.execute.worker import PairJob

        start = perf_counter()
        done = self._worker.run(jobs, sources)
        if any(isinstance(job, PairJob) for job in jobs):
            self.registering += perf_counter() - start
        else:
            self.signing += perf_counter() - start
        return done

    def release(self) -> None:
        self._worker.release()


def _ours(scans: Sequence[Scan], surveys: Sequence[int], grid: "Grid", device: str | None) -> MappedSurvey:
    """As `sonarmap map` does it with nothing but defaults, in this process."""
    from sonarmap.kernels.device.device import choose_device
    from sonarmap.slam.execute.runner import Execution
    from sonarmap.slam.execute.worker import Worker, prepared_limit
    from sonarmap.slam.mapper import Mapper
    from sonarmap.spectral.registration import SpectralRegistrar
    from sonarmap.tools.files.memory import peak_memory

    opened = choose_device(device)
    registrar = SpectralRegistrar(opened, grid)
    worker = _TimedWorker(Worker(registrar, prepared_limit(registrar)))
    execution = Execution(worker)
    start = perf_counter()
    result = Mapper(registrar, grid.voxel, execution=execution).run(scans, surveys=surveys)
    time = _took(perf_counter() - start, execution.timings.stages["map fused"], worker, result, peak_memory())
    return _mapped(result, time, _signatures(registrar, scans))


def _took(total: float, fused: float, worker: _TimedWorker, result: "SurveyResult", memory: int) -> MappingTime:
    """The stage of fusing computes the poses' covariances too, which are the optimizer's work and timed anew here."""
    from sonarmap.slam.graph.pose_covariance import pose_covariances

    start = perf_counter()
    pose_covariances(result.solution)
    fusing = max(0.0, fused - (perf_counter() - start))
    rest = total - worker.registering - worker.signing - fusing
    return MappingTime(total, memory, worker.registering, worker.signing, rest, fusing)


def _mapped(result: "SurveyResult", time: MappingTime, signatures: dict[int, np.ndarray]) -> MappedSurvey:
    from sonarmap.slam.parts import placed

    largest = placed(result.components)[0]
    members, part = list(result.components[largest]), result.parts[largest]
    before, after = part.crossings.before, part.crossings.after
    return MappedSurvey(
        placed=tuple(members),
        components=sum(len(component) > 1 for component in result.components),
        trajectory=result.trajectory.take(members),
        chained=part.chained_poses,
        covariances=result.covariances[members],
        pairs=tuple(_tried(pair) for pair in result.pairs),
        points=part.optimized.points,
        seen=part.optimized.seen,
        crossings=Crossings(before.median, after.median) if before and after else Crossings(),
        signatures=signatures,
        time=time,
    )


def _tried(pair: "Pair") -> TriedPair:
    """With the answer that was kept, where it is not the registration's first."""
    answer = pair.edge.registration if pair.edge else pair.registration
    return TriedPair(pair.i, pair.j, pair.role, pair.kept, answer.T_target_source if answer else None)


def _signatures(registrar: "SpectralRegistrar", scans: Sequence[Scan]) -> dict[int, np.ndarray]:
    """Of the scans that show enough, by their number."""
    signatures = {}
    for k, scan in enumerate(scans):
        try:
            signatures[k] = registrar.signature(registrar.prepare(scan))
        except InputError:
            continue
    return signatures


def _peer(system: str, scans: Sequence[Scan], grid: "Grid") -> MappedSurvey:
    """Another system's poses, and the map that this project's fusing makes with them."""
    from sonarmap.slam.map.component_maps import clean_map
    from sonarmap.slam.map.placed import PlacedScans
    from sonarmap.tools.files.memory import peak_memory

    run = _run_peer(system, scans, grid.voxel)
    time = MappingTime(run.seconds, peak_memory())
    placed = run.trajectory.stamps.astype(int).tolist()
    chosen = [scans[k] for k in placed]
    fused = clean_map(PlacedScans.of(chosen, run.trajectory.T_world_sensor, grid.voxel, placed)).clean
    return MappedSurvey(
        placed=tuple(placed),
        components=1,
        trajectory=run.trajectory,
        chained=None,
        covariances=None,
        pairs=run.pairs,
        points=fused.points,
        seen=fused.seen,
        crossings=Crossings(),
        signatures={},
        time=time,
    )


def _run_peer(system: str, scans: Sequence[Scan], voxel: float) -> "SlamRun":
    if system == "multiway":
        from sonarmap.tools.lab.baselines.surveys import run_multiway

        return run_multiway(scans, voxel)
    from sonarmap.tools.lab.baselines.surveys import run_kiss_slam

    return run_kiss_slam(scans, voxel)
