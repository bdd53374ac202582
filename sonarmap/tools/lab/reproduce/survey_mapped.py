"""Maps a survey as `sonarmap map` does, in a separate process to measure its memory."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from time import perf_counter

import numpy as np

from sonarmap.kernels.device.device import choose_device
from sonarmap.slam.execute.processes import spawned
from sonarmap.slam.execute.runner import Execution
from sonarmap.slam.execute.worker import Worker, prepared_limit
from sonarmap.slam.graph.trajectory import Trajectory
from sonarmap.slam.mapper import Mapper
from sonarmap.slam.pair import Pair
from sonarmap.slam.parts import placed
from sonarmap.slam.survey_result import SurveyResult
from sonarmap.spectral.grid import Grid
from sonarmap.spectral.registration import SpectralRegistrar
from sonarmap.spectral.scan import Scan
from sonarmap.tools.files.map_folder.names import TriedPair
from sonarmap.tools.files.memory import peak_memory


@dataclass(frozen=True, slots=True)
class MappedSurvey:
    """The mapper's result for a survey."""

    placed: tuple[int, ...]  # the scans of its largest component, ascending
    trajectory: Trajectory  # poses of the placed scans in an arbitrary frame; stamps are the scans' numbers
    pairs: tuple[TriedPair, ...]  # all tried pairs, by the scans' numbers
    points: np.ndarray  # (M, 3) of the map, in the trajectory's frame [m]
    seen: np.ndarray  # (M,) int, number of scans that saw each point
    covariances: np.ndarray  # (n, 6, 6) of the poses relative to the first, rotation first [rad, m], body tangent
    components: int = 1  # number of components of two or more scans
    seconds: float = float("nan")  # wall time from the first scan to the last result [s]
    memory: int = 0  # peak resident memory of the process [bytes]


def map_survey(scans: Sequence[Scan], surveys: Sequence[int], grid: Grid, device: str | None) -> MappedSurvey:
    """Map a survey with default settings in a new process; the stamps of the scans have to be 0, 1, 2, ...

    `surveys` are the ascending numbers of the scans' surveys. Raises InputError, DeviceError: the scans or the device
    cannot be used.
    """
    with spawned(1) as pool:
        return pool.submit(_map, scans, surveys, grid, device).result()


def _map(scans: Sequence[Scan], surveys: Sequence[int], grid: Grid, device: str | None) -> MappedSurvey:
    """Map in this process."""
    registrar = SpectralRegistrar(choose_device(device), grid)
    execution = Execution(Worker(registrar, prepared_limit(registrar)))
    start = perf_counter()
    result = Mapper(registrar, grid.voxel, execution=execution).run(scans, surveys=surveys)
    return replace(mapped_of(result), seconds=perf_counter() - start, memory=peak_memory())


def mapped_of(result: SurveyResult) -> MappedSurvey:
    """The result of our mapper, without time and memory."""
    largest = placed(result.components)[0]
    members, part = list(result.components[largest]), result.parts[largest]
    return MappedSurvey(
        placed=tuple(members),
        trajectory=result.trajectory.take(members),
        pairs=tuple(_tried(pair) for pair in result.pairs),
        points=part.optimized.points,
        seen=part.optimized.seen,
        covariances=result.covariances[members],
        components=sum(len(component) > 1 for component in result.components),
    )


def _tried(pair: Pair) -> TriedPair:
    """A pair with the transform of its edge, if it has one, else of its registration."""
    answer = pair.edge.registration if pair.edge else pair.registration
    return TriedPair(pair.i, pair.j, pair.role, pair.kept, answer.T_target_source if answer else None)
