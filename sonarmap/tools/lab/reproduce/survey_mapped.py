"""Maps a survey by one system, in a separate process to measure its memory."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
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

OURS = "sonarmap"
PEERS = ("multiway", "kiss-slam")
SYSTEMS = (OURS, *PEERS)


@dataclass(frozen=True, slots=True)
class MappedSurvey:
    """A system's result for a survey."""

    placed: tuple[int, ...]  # the scans of its largest component, ascending
    trajectory: Trajectory  # poses of the placed scans in an arbitrary frame; stamps are the scans' numbers
    pairs: tuple[TriedPair, ...]  # all tried pairs, by the scans' numbers
    points: np.ndarray  # (M, 3) of the map, in the trajectory's frame [m]
    seen: np.ndarray  # (M,) int, number of scans that saw each point
    seconds: float = float("nan")  # wall time from the first scan to the last result [s]
    memory: int = 0  # peak resident memory of the process [bytes]
    components: int = 1  # number of components of two or more scans
    # (n, 6, 6) of the poses relative to the first, rotation first [rad, m], body tangent; None if not returned
    covariances: np.ndarray | None = None


def map_survey(
    system: str, scans: Sequence[Scan], surveys: Sequence[int], grid: "Grid", device: str | None
) -> MappedSurvey:
    """Map a survey by one of SYSTEMS in a new process; the stamps of the scans have to be 0, 1, 2, ...

    `surveys` are the ascending numbers of the scans' surveys. Other systems than ours use only the voxel of the grid.
    Raises InputError, DeviceError: the scans, the package or the device cannot be used.
    """
    with spawned(1) as pool:
        if system == OURS:
            return pool.submit(_ours, scans, surveys, grid, device).result()
        return pool.submit(_peer, system, scans, grid).result()


def installed(system: str) -> bool:
    """Whether the package of a system is installed; true if it needs none."""
    from sonarmap.tools.extras import load_package

    if system != "kiss-slam":
        return True
    try:
        load_package("kiss_slam.slam", "kiss-slam", "the method kiss-slam", "slam-peers")
    except InputError:
        return False
    return True


def _ours(scans: Sequence[Scan], surveys: Sequence[int], grid: "Grid", device: str | None) -> MappedSurvey:
    """Map as `sonarmap map` does with default settings, in this process."""
    from sonarmap.kernels.device.device import choose_device
    from sonarmap.slam.execute.runner import Execution
    from sonarmap.slam.execute.worker import prepared_limit
    from sonarmap.slam.mapper import Mapper
    from sonarmap.spectral.registration import SpectralRegistrar
    from sonarmap.tools.files.memory import peak_memory

    registrar = SpectralRegistrar(choose_device(device), grid)
    execution = Execution.here(registrar, prepared_limit(registrar))
    start = perf_counter()
    result = Mapper(registrar, grid.voxel, execution=execution).run(scans, surveys=surveys)
    return replace(mapped_of(result), seconds=perf_counter() - start, memory=peak_memory())


def mapped_of(result: "SurveyResult") -> MappedSurvey:
    """The result of our mapper, without time and memory."""
    from sonarmap.slam.parts import placed

    largest = placed(result.components)[0]
    members, part = list(result.components[largest]), result.parts[largest]
    return MappedSurvey(
        placed=tuple(members),
        trajectory=result.trajectory.take(members),
        pairs=tuple(_tried(pair) for pair in result.pairs),
        points=part.optimized.points,
        seen=part.optimized.seen,
        components=sum(len(component) > 1 for component in result.components),
        covariances=result.covariances[members],
    )


def _tried(pair: "Pair") -> TriedPair:
    """A pair with the transform of its edge, if it has one, else of its registration."""
    answer = pair.edge.registration if pair.edge else pair.registration
    return TriedPair(pair.i, pair.j, pair.role, pair.kept, answer.T_target_source if answer else None)


def _peer(system: str, scans: Sequence[Scan], grid: "Grid") -> MappedSurvey:
    """Map by another system, and fuse the points at its poses as our mapper does."""
    from sonarmap.slam.map.doubtful_points import clean_map
    from sonarmap.slam.map.placed import PlacedScans
    from sonarmap.tools.files.memory import peak_memory
    from sonarmap.tools.lab.baselines import surveys

    run = (surveys.run_multiway if system == "multiway" else surveys.run_kiss_slam)(scans, grid.voxel)
    memory = peak_memory()
    placed = run.trajectory.stamps.astype(int).tolist()
    chosen = [scans[k] for k in placed]
    fused = clean_map(PlacedScans.of(chosen, run.trajectory.T_world_sensor, grid.voxel, placed)).clean
    return MappedSurvey(tuple(placed), run.trajectory, run.pairs, fused.points, fused.seen, run.seconds, memory)
