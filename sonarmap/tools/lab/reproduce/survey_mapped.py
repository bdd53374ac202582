"""A survey mapped by one system, in a process of its own, so that its memory is the system's alone."""

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from time import perf_counter
from typing import TYPE_CHECKING

import numpy as np

from sonarmap.kernels.errors import InputError
from sonarmap.slam.execute.processes import spawned
from sonarmap.slam.graph.trajectory import Trajectory
from sonarmap.spectral.scan import Scan
from sonarmap.tools.files.map_folder.names import TriedPair

if TYPE_CHECKING:
    from sonarmap.slam.pair import Pair
    from sonarmap.slam.survey_result import SurveyResult
    from sonarmap.spectral.grid import Grid
    from sonarmap.spectral.registration import SpectralRegistrar

OURS = "sonarmap"
PEERS = ("multiway", "kiss-slam")
SYSTEMS = (OURS, *PEERS)


@dataclass(frozen=True, slots=True)
class MappedSurvey:
    """What a system made of a survey."""

    placed: tuple[int, ...]  # the scans of its largest component, ascending
    trajectory: Trajectory  # the poses of the placed scans, in a frame of their own; stamps count the survey's scans
    pairs: tuple[TriedPair, ...]  # all that were tried, as the scans' numbers
    points: np.ndarray  # (M, 3) [m], of the map in the trajectory's frame
    seen: np.ndarray  # (M,) int, how many scans saw each
    # wall time from the first scan to the last result, and parts of it [s], with `STAGES` as names; and "memory", the
    # most that its process had resident [bytes]
    took: Mapping[str, float]
    components: int = 1  # how many have two scans or more
    chained: Trajectory | None = None  # the same before loops; None of a system that does not tell
    # (n, 6, 6) of the poses against the first of them, rotation first [rad, m], body tangent; None likewise
    covariances: np.ndarray | None = None
    # how far tracks that cross lie apart, the median of their medians [m], before and after the loops
    crossings: tuple[float, float] = (float("nan"), float("nan"))
    signatures: Mapping[int, np.ndarray] = field(default_factory=dict)  # by scan, of those that have one


# The times of a system; "optimizing" is all the rest, with the choice of loops
STAGES = ("total", "registering", "signing", "optimizing", "fusing")


def map_survey(
    system: str, scans: Sequence[Scan], surveys: Sequence[int], grid: "Grid", device: str | None
) -> MappedSurvey:
    """Map a survey by one of SYSTEMS in a new process, from scans in their order with stamps that count them from 0.

    `surveys` are the numbers of the scans' surveys, ascending; of the grid, other systems take the voxel alone. Raises
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


def _ours(scans: Sequence[Scan], surveys: Sequence[int], grid: "Grid", device: str | None) -> MappedSurvey:
    """As `sonarmap map` does it with nothing but defaults, in this process."""
    from sonarmap.kernels.device.device import choose_device
    from sonarmap.slam.execute.runner import Execution
    from sonarmap.slam.execute.worker import Job, PairJob, Sources, TimedText, Worker, prepared_limit
    from sonarmap.slam.graph.pose_covariance import pose_covariances
    from sonarmap.slam.mapper import Mapper
    from sonarmap.spectral.registration import SpectralRegistrar
    from sonarmap.tools.files.memory import peak_memory

    registrar = SpectralRegistrar(choose_device(device), grid)
    took = {"registering": 0.0, "signing": 0.0}

    class TimedWorker(Worker):
        def run(self, jobs: Sequence[Job], sources: Sources) -> list[TimedText]:
            start = perf_counter()
            done = super().run(jobs, sources)
            stage = "registering" if any(isinstance(job, PairJob) for job in jobs) else "signing"
            took[stage] += perf_counter() - start
            return done

    execution = Execution(TimedWorker(registrar, prepared_limit(registrar)))
    start = perf_counter()
    result = Mapper(registrar, grid.voxel, execution=execution).run(scans, surveys=surveys)
    took["total"], took["memory"] = perf_counter() - start, peak_memory()
    # the stage of fusing computes the poses' covariances too, which are the optimizer's work and timed anew here
    start = perf_counter()
    pose_covariances(result.solution)
    took["fusing"] = max(0.0, execution.timings.stages["map fused"] - (perf_counter() - start))
    took["optimizing"] = took["total"] - took["registering"] - took["signing"] - took["fusing"]
    return replace(mapped_of(result), took=took, signatures=_signatures(registrar, scans))


def mapped_of(result: "SurveyResult") -> MappedSurvey:
    """What this project's mapper made, without times and signatures."""
    from sonarmap.slam.parts import placed

    largest = placed(result.components)[0]
    members, part = list(result.components[largest]), result.parts[largest]
    before, after = part.crossings.before, part.crossings.after
    mapped = MappedSurvey(
        placed=tuple(members),
        trajectory=result.trajectory.take(members),
        pairs=tuple(_tried(pair) for pair in result.pairs),
        points=part.optimized.points,
        seen=part.optimized.seen,
        took={},
        components=sum(len(component) > 1 for component in result.components),
        chained=result.chained.take(members),
        covariances=result.covariances[members],
    )
    return replace(mapped, crossings=(before.median, after.median)) if before and after else mapped


def _tried(pair: "Pair") -> TriedPair:
    """With the answer that was kept, where it is not the registration's first."""
    answer = pair.edge.registration if pair.edge else pair.registration
    return TriedPair(pair.i, pair.j, pair.role, pair.kept, answer.T_target_source if answer else None)


def _signatures(registrar: "SpectralRegistrar", scans: Sequence[Scan]) -> dict[int, np.ndarray]:
    """Of the scans that show enough, by their number."""
    signatures = {}
    for k, scan in enumerate(scans):
        with suppress(InputError):
            signatures[k] = registrar.signature(registrar.prepare(scan))
    return signatures


def _peer(system: str, scans: Sequence[Scan], grid: "Grid") -> MappedSurvey:
    """Another system's poses, and the map that this project's fusing makes with them."""
    from sonarmap.slam.map.component_maps import clean_map
    from sonarmap.slam.map.placed import PlacedScans
    from sonarmap.tools.files.memory import peak_memory
    from sonarmap.tools.lab.baselines import surveys

    run = (surveys.run_multiway if system == "multiway" else surveys.run_kiss_slam)(scans, grid.voxel)
    took = {"total": run.seconds, "memory": peak_memory()}
    placed = run.trajectory.stamps.astype(int).tolist()
    chosen = [scans[k] for k in placed]
    fused = clean_map(PlacedScans.of(chosen, run.trajectory.T_world_sensor, grid.voxel, placed)).clean
    return MappedSurvey(tuple(placed), run.trajectory, run.pairs, fused.points, fused.seen, took)
