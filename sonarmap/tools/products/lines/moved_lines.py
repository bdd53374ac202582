"""The lines of a map, as they were recorded and where the map has them."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from sonarmap.slam.pings.biases import corrected
from sonarmap.slam.pings.line import PingLine
from sonarmap.slam.pings.moved import moved
from sonarmap.slam.survey_result import SurveyResult
from sonarmap.tools.files.geo.georeference import Georeference
from sonarmap.tools.files.readers.clouds.cloud import PingPatch
from sonarmap.tools.files.readers.pings.line_file import read_line
from sonarmap.tools.files.readers.pings.patches import LineReading


@dataclass(frozen=True, slots=True)
class MovedLine:
    """One line.

    Attributes:
        path: its file.
        before: as it was recorded, in the map's world.
        after: as the map has it.
        sigmas: (P, 6) standard deviations of the pings' poses afterwards: rotation about East, North, Up [rad], then
            along these [m].
    """

    path: Path
    before: PingLine
    after: PingLine
    sigmas: np.ndarray

    @property
    def shifts(self) -> np.ndarray:
        """(P, 3) East, North, Up [m] by which the map moves the pings' places."""
        return self.after.places - self.before.places


def moved_lines(
    patches: Mapping[int, PingPatch], result: SurveyResult, georeference: Georeference, reading: LineReading
) -> list[MovedLine]:
    """The lines of which patches lie in the world, in the order of their first scans; files are read again.

    Args:
        patches: by scan.
        georeference: of the map's world.
        reading: as their patches were cut.

    Raises:
        InputError: a file was changed or removed since.
    """
    placed = {k for k, prior in result.solution.graph.priors if prior.knows_position}
    in_world = {k for members in result.components if placed.intersection(members) for k in members}
    of_files: dict[Path, list[int]] = {}
    for k in sorted(patches):
        if k in in_world:
            of_files.setdefault(patches[k].path, []).append(k)
    lines: list[MovedLine] = []
    for path, scans in of_files.items():
        recorded = read_line(path, []).immersed(reading.draught).placed(georeference)
        before = corrected(recorded, reading.biases)
        middles = np.array([patches[k].middle for k in scans])
        after, sigmas = moved(before, middles, result.trajectory.T_world_sensor[scans], result.covariances[scans])
        lines.append(MovedLine(path, recorded, after, sigmas))
    return lines
