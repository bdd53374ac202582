"""navigation.csv, soundings.laz and lines.json: the files of a map from lines of pings."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from sonarmap.slam.pings.biases import corrected
from sonarmap.slam.pings.calibration import PatchTest
from sonarmap.slam.pings.crossings import Crossings
from sonarmap.slam.pings.line import PingLine
from sonarmap.slam.pings.pieces import moved
from sonarmap.slam.survey_result import SurveyResult
from sonarmap.tools.files.geo import Georeference, Projection
from sonarmap.tools.files.map_folder.names import LINES, NAVIGATION, OF_LINES, SOUNDINGS, write_summary
from sonarmap.tools.files.readers.clouds.cloud import PingPatch
from sonarmap.tools.files.readers.csv_table import SUMMARY
from sonarmap.tools.files.readers.pings.line_file import LineReading, read_line
from sonarmap.tools.files.time_scales import are_times, utc_texts
from sonarmap.tools.files.user_file import read_json
from sonarmap.tools.files.writers.atomic import all_or_none, atomic_path
from sonarmap.tools.files.writers.tables import write_json, write_table
from sonarmap.tools.products.export.clouds import BATHYMETRIC, gps_times, las_header

COLUMNS = (
    *("line", "ping", "utc", "unix_s", "lat_deg", "lon_deg", "easting_m", "northing_m", "height_m"),
    *("roll_deg", "pitch_deg", "heading_deg", "moved_east_m", "moved_north_m", "moved_up_m"),
    *("east_sigma_m", "north_sigma_m", "up_sigma_m", "rot_east_sigma_deg", "rot_north_sigma_deg", "rot_up_sigma_deg"),
    "crs",
)
_DECIMALS = (10, 10, 4, 4, 4, 5, 5, 5, 4, 4, 4, 4, 4, 4, 5, 5, 5)  # of the columns from lat_deg to rot_up_sigma_deg
_DIMENSIONS = {"ping": ("u4", "ping of the line, from 0"), "beam_angle": ("f4", "from down, + starboard [deg]")}


@dataclass(frozen=True, slots=True)
class MovedLine:
    path: Path  # of its file
    before: PingLine  # as recorded, in the map's world
    after: PingLine  # at the map's poses
    sigmas: np.ndarray  # (P, 6) of the pings' poses in the map: rotation about, then shift, East, North, Up [rad, m]

    @property
    def shifts(self) -> np.ndarray:
        """(P, 3) East, North, Up [m] by which the map moves the pings' positions."""
        return self.after.places - self.before.places


def moved_lines(
    patches: Mapping[int, PingPatch], result: SurveyResult, georeference: Georeference, reading: LineReading
) -> list[MovedLine]:
    """Lines with patches in the world, by their first scans, read again from their files; `patches` by scan, cut with
    the draught and biases of `reading`."""
    placed = {k for k, prior in result.solution.graph.priors if prior.knows_position}
    in_world = {k for members in result.components if placed.intersection(members) for k in members}
    of_files: dict[Path, list[int]] = {}
    for k in sorted(patches):
        if k in in_world:
            of_files.setdefault(patches[k].path, []).append(k)
    lines: list[MovedLine] = []
    for path, scans in of_files.items():
        recorded = read_line(path, [], reading).placed(georeference)
        before = corrected(recorded, reading.biases)
        middles = np.array([patches[k].middle for k in scans])
        after, sigmas = moved(before, middles, result.trajectory.T_world_sensor[scans], result.covariances[scans])
        lines.append(MovedLine(path, recorded, after, sigmas))
    return lines


def write_lines(
    folder: Path,
    lines: Sequence[MovedLine],
    georeference: Georeference,
    crs: str | None,
    agreement: tuple[Crossings, Crossings],
    test: PatchTest | None,
) -> None:
    """Write the files of a map's lines; `agreement` is that of overlapping lines, before and after, and `test` None
    where the lines overlap too little."""
    projection, (before, after) = Projection.of(georeference, crs), agreement
    content = {
        "lines": [_summary(line) for line in lines],
        "crs": projection.name,
        "crossings": {"before": before.to_json(), "after": after.to_json()} if before.cells else None,
        "patch_test": None if test is None else test.to_json(),
    }
    summary = read_json(folder / SUMMARY, "the map's summary.json")
    with all_or_none():
        write_table(folder / NAVIGATION, COLUMNS, _rows(lines, georeference, projection))
        _write_soundings(folder / SOUNDINGS, lines, georeference, projection)
        write_json(folder / LINES, content)
        write_summary(folder, summary, OF_LINES)


def _summary(line: MovedLine) -> dict[str, Any]:
    far = np.linalg.norm(line.shifts, axis=1)
    moved = {"median": np.median(far).item(), "most": far.max().item()}
    return {
        "file": line.path.name,
        "pings": len(line.after.stamps),
        "soundings": len(line.after.pings),
        "seconds": np.ptp(line.after.stamps).item(),
        "length_m": np.linalg.norm(np.diff(line.after.places, axis=0), axis=1).sum().item(),
        "moved_m": moved | {"mean_east_north_up": line.shifts.mean(axis=0).tolist()},
    }


def _rows(lines: Sequence[MovedLine], georeference: Georeference, projection: Projection) -> list[list[object]]:
    """One row per ping, under COLUMNS."""
    rows: list[list[object]] = []
    for line in lines:
        after = line.after
        geodetic = georeference.geodetic(after.places)
        numbers = np.column_stack(
            [
                *(geodetic[:, :2], projection.project(geodetic)),
                *(np.degrees(after.attitudes), line.shifts, line.sigmas[:, 3:], np.degrees(line.sigmas[:, :3])),
            ]
        )
        texts = [[f"{x:z.{n}f}" for x in column] for n, column in zip(_DECIMALS, numbers.T.tolist(), strict=True)]
        unix = [repr(stamp) for stamp in after.stamps.tolist()]
        for k, row in enumerate(zip(utc_texts(after.stamps), unix, *texts, strict=True)):
            rows.append([after.name, k, *row, projection.name])
    return rows


def _write_soundings(
    path: Path, lines: Sequence[MovedLine], georeference: Georeference, projection: Projection
) -> None:
    """LAZ 1.4, point format 6, line by line: easting, northing, height, ping and beam angle of each sounding; the point
    source is the number of the line, from 1."""
    import laspy

    timed = all(are_times(line.after.stamps) for line in lines)
    here = georeference.geodetic(lines[0].after.places[:1])
    header = las_header(projection, projection.project(here)[0], _DIMENSIONS, timed)
    with (
        atomic_path(path) as temporary,
        temporary.open("wb") as file,
        laspy.open(file, mode="w", header=header, do_compress=True, closefd=False) as writer,
    ):
        for number, line in enumerate(lines, 1):
            after = line.after
            points = laspy.ScaleAwarePointRecord.zeros(len(after.pings), header=header)
            points.x, points.y, points.z = projection.project(georeference.geodetic(after.world_points())).T
            points.gps_time = gps_times(after.stamps[after.pings], timed)
            points.return_number[:] = 1
            points.number_of_returns[:] = 1
            points.classification[:] = BATHYMETRIC
            points.point_source_id[:] = min(number, 65_535)
            points.ping = after.pings
            points.beam_angle = np.degrees(after.beam_angles())
            writer.write_points(points)
