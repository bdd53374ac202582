"""Functions of `import sonarmap` for finished maps: write, export and open them, and fuse scans again.

In: results, scans, folders. Out: the same files as the command line's, and the map as an object.
"""

import os
from collections.abc import Iterable, Sequence
from dataclasses import replace
from inspect import signature
from numbers import Integral
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.spatial.transform import RigidTransform

from sonarmap.kernels.errors import InputError
from sonarmap.slam.graph.trajectory import Trajectory
from sonarmap.slam.survey_result import SurveyResult
from sonarmap.tools.files.geo import Georeference
from sonarmap.tools.files.map_folder.folder import Map
from sonarmap.tools.files.writers.atomic import locked
from sonarmap.tools.given import (
    ScanLike,
    as_arguments,
    as_covariances,
    as_list,
    as_numbers,
    as_paths,
    as_survey,
    as_surveys,
    public,
    require_type,
)

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from sonarmap.slam.execute.runner import Progress
    from sonarmap.slam.map.point_map import PointMap
    from sonarmap.tools.files.readers.navigation.priors import Navigated
    from sonarmap.tools.files.readers.navigation.settings import NavFrame
    from sonarmap.tools.files.time_scales import TimeScale
    from sonarmap.tools.products.export.run import Exported

_ORTHONORMAL = 1e-3  # tolerance of a rotation's elements, which may be rounded


@public
def write_map(
    result: SurveyResult,
    folder: str | os.PathLike[str],
    *,
    inputs: str | os.PathLike[str] | Sequence[str | os.PathLike[str]] = (),
    georeference: Georeference | None = None,
    report: bool = True,
) -> Map:
    """Write a map as `sonarmap map` does: map.ply, trajectory.tum, graph.g2o, summary.json, pictures, report.html, ...

    All files appear together, or none; those of an earlier map in the folder are replaced. All commands for finished
    maps accept the folder.

    Args:
        result: the result of `map_scans`.
        folder: the map's folder; it is created if it is missing.
        inputs: the files, folders or patterns that the scans were read from, without corrections. Exports of all
            scans' points and the report's title need them.
        georeference: where the map lies on the Earth; None if that is unknown.
        report: whether to write report.html too.

    Returns:
        The map, as `Map.open` gives it.

    Raises:
        InputError: an argument cannot be used, or a file cannot be written.
    """
    from sonarmap.tools.files.map_folder.names import require_apart
    from sonarmap.tools.files.readers.scans import FORMATS, files_of
    from sonarmap.tools.files.readers.selection import select_files
    from sonarmap.tools.files.user_file import input_rows
    from sonarmap.tools.files.writers.atomic import require_writable
    from sonarmap.tools.products.output.folder import SurveyRun, write_survey

    require_type("folder", [folder], str, os.PathLike)
    require_type("result", [result], SurveyResult)
    require_type("georeference", [georeference], Georeference, None)
    out, paths = Path(folder), as_paths("inputs", inputs)
    files = files_of(select_files(paths, FORMATS)) if paths else ()
    require_apart(out, files)
    settings = {"inputs": paths} if paths else {}
    run = SurveyRun(result.names, settings, inputs=input_rows(files), georeference=georeference)
    require_writable(out)
    with locked(out, writing=True):
        write_survey(out, result, run)
    if report:
        write_report(out)
    return Map.open(out)


@public
def write_report(folder: Map | str | os.PathLike[str]) -> Path:
    """Write report.html into a finished map's folder, as `sonarmap view --rebuild` does: the map in 3D, its loops and
    its uncertainty.

    Args:
        folder: the map's folder, or the map.

    Returns:
        The report's path.

    Raises:
        InputError: the map's files are missing or damaged, or the report cannot be written.
    """
    from sonarmap.tools.products.report.page import write_report as write_page

    finished = opened_map(folder)
    with locked(finished.path, writing=True):
        return write_page(finished)


@public
def export_map(
    folder: Map | str | os.PathLike[str],
    to: str | os.PathLike[str],
    formats: str | Iterable[str],
    *,
    origin: Georeference | None = None,
    crs: str | None = None,
    cell: float | None = None,
    height: str = "top",
    points: str = "map",
    scans: Iterable[int] | None = None,
    scans_from: Sequence[str | os.PathLike[str]] = (),
    progress: "Progress | None" = None,
) -> "Exported":
    """Write a finished map in other programs' formats, as `sonarmap export` does; all files appear together, or none.

    Args:
        folder: the map, or its folder.
        to: folder for the files; it is created if it is missing.
        formats: names of formats, such as "laz" or ["laz", "geotiff", "kmz"]: see docs/export.md.
        origin: where the map lies on the Earth; None for the map's own georeference.
        crs: projected CRS, such as "EPSG:25832"; "map" for points in the map's frame; None for the UTM zone.
        cell: edge of a grid's cell [m]; None for two voxels, rounded up to 1, 2 or 5 times a power of ten.
        height: height of a grid's cell: "top", "mean" or "shoalest".
        points: "map" for the map's points, or "all" for every point of every scan, which is read again.
        scans: the numbers of the scans whose points are written; None for all.
        scans_from: where the scans' files are now; empty if they have not moved.
        progress: called with (files written, files in all, the next one's name).

    Raises:
        InputError: an argument cannot be used, the map lacks what a format needs, or a file cannot be written.
    """
    from sonarmap.tools.products.export.formats import HEIGHTS, known_formats
    from sonarmap.tools.products.export.run import ExportSettings
    from sonarmap.tools.products.export.run import export_map as export

    require_type("origin", [origin], Georeference, None)
    for name, value, known in (("height", height, tuple(HEIGHTS)), ("points", points, ("map", "all"))):
        if value not in known:
            raise InputError(f"`{name}={value!r}` is not known; choose one of {', '.join(known)}")
    finished = opened_map(folder)
    finished = finished if origin is None else replace(finished, georeference=origin)
    settings = ExportSettings(
        tuple(known_formats(as_list("formats", formats, (str,), "the name of a format, or a list of names"))),
        *(crs, cell, height, points == "all"),
        None if scans is None else tuple(sorted({*as_list("scans", scans, (Integral,), "numbers of scans")})),
        tuple(as_paths("scans_from", scans_from)),
    )
    with locked(finished.path, writing=Path(to).resolve() == finished.path.resolve()):
        exported = export(finished, Path(to), settings, progress)
    return replace(
        exported, notes=tuple(as_arguments(note, signature(export_map).parameters) for note in exported.notes)
    )


@public
def read_navigation(
    logs: str | os.PathLike[str] | Sequence[str | os.PathLike[str]],
    scans: Iterable[ScanLike] | str | os.PathLike[str],
    *,
    origin: Georeference | None = None,
    sigmas: Sequence[float] | None = None,
    columns: dict[str, str] | None = None,
    time_scale: "TimeScale | None" = None,
    offset: float = 0.0,
    crs: str | None = None,
    frame: "NavFrame | None" = None,
    T_vehicle_sensor: RigidTransform | None = None,
    heading_reference: str = "true",
    declination: float | None = None,
    nmea_talker: str | None = None,
    correct: str | None = None,
) -> "Navigated":
    """Add priors to scans: poses that instruments measured, read as in `sonarmap map --priors` (docs/navigation.md).

    Args:
        logs: a CSV, TUM or NMEA 0183 log, a ROS bag or MCAP file, or several, each for other quantities or other scans.
        scans: as in `map_scans`; rows are matched to them by name, stamp or time.
        origin: origin of the map's frame; None for the first fix, if the file has any on the Earth.
        sigmas: standard deviations for files without any: roll, pitch, heading [rad], East, North, Up [m].
        columns: {quantity: heading of its column}, such as {"depth_m": "KP_DEPTH"}, for headings that are not standard.
        time_scale: scale of times without a zone: "utc", "gps" or "tai"; None for UTC.
        offset: added to the log's times [s].
        crs: CRS of the log's eastings and northings, such as "EPSG:32632".
        frame: frame of pitch, yaw, x, y, z: "frd", "ned", "flu" or "enu"; None for headings, pitch nose up and depths.
        T_vehicle_sensor: pose of the sonar on the navigated vehicle [m, x forward, y left, z up]; None if the log has
            the sonar's own pose.
        heading_reference: North of the headings: "true" or "grid".
        declination: added to magnetic headings [rad], East positive; None if the headings are not magnetic.
        nmea_talker: talkers of the NMEA sentences to use, such as "GP,HE"; None for all, which have to agree.
        correct: correction of the priors, as in `--correct-priors`, such as "heading_deg=-heading_deg"; None for none.

    Returns:
        The scans with priors, and the georeference of their world frame, for `write_map`.

    Raises:
        InputError: a log cannot be read (the message names file and line), or an argument cannot be used.
    """
    from types import MappingProxyType

    from sonarmap.tools.files.readers.navigation.correction import Correction
    from sonarmap.tools.files.readers.navigation.priors import navigate
    from sonarmap.tools.files.readers.navigation.settings import Mount, NavigationSettings, parse_talkers

    paths: list[Any] = [*logs] if isinstance(logs, list | tuple) else [logs]
    require_type("logs", paths or [None], str, os.PathLike)
    require_type("T_vehicle_sensor", [T_vehicle_sensor], RigidTransform, None)
    require_type("origin", [origin], Georeference, None)
    settings = NavigationSettings(
        columns=MappingProxyType(columns or {}),
        time_scale=time_scale,
        offset=offset,
        crs=crs,
        origin=origin,
        heading_reference=heading_reference,
        declination=None if declination is None else float(np.rad2deg(declination)),
        frame=frame,
        mount=None if T_vehicle_sensor is None else Mount(T_vehicle_sensor),
        sigmas={} if sigmas is None else _sigmas_by_column(sigmas),
        talkers=() if nmea_talker is None else parse_talkers(nmea_talker),
        correction=None if correct is None else Correction.of(correct),
    )
    return navigate(as_survey(scans), [Path(each) for each in paths], settings)


def _sigmas_by_column(sigmas: Sequence[float]) -> dict[str, float]:
    """Roll, pitch and heading [rad] and East, North and Up [m] by the columns of a log, [deg] and [m]."""
    from sonarmap.tools.files.readers.instruments import COLUMNS

    given = as_numbers("sigmas", sigmas, (6,), finite=False)
    if not (np.isnan(given) | (given > 0)).all():
        raise InputError(f"`sigmas={sigmas!r}` cannot be used; wanted six numbers above zero: [rad] x 3, [m] x 3")
    return dict(zip(COLUMNS, [*np.rad2deg(given[:3]).tolist(), *given[3:].tolist()], strict=True))


@public
def fuse(
    scans: Iterable[ScanLike] | str | os.PathLike[str],
    poses: "Trajectory | RigidTransform | NDArray[Any]",
    voxel: float,
    *,
    covariances: np.ndarray | None = None,
    surveys: Sequence[int] | None = None,
) -> "PointMap":
    """Fuse scans at known poses into one map, without the points that free space contradicts, as `map_scans` does.

    Args:
        scans: N scans, as in `map_scans`.
        poses: N poses, p_world = T_world_sensor p_sensor [m]; an array of them has shape (N, 4, 4).
        voxel: edge of the map's voxels [m].
        covariances: (N, 6, 6) of the poses, rotation first [rad, m], body tangent; None if the poses are exact.
        surveys: the survey number of each scan, ascending; None for one survey.

    Raises:
        InputError: the numbers of poses and scans differ, or an argument cannot be used.
    """
    from sonarmap.slam.map.doubtful_points import clean_map
    from sonarmap.slam.map.placed import PlacedScans

    require_type("poses", [poses], Trajectory, RigidTransform, np.ndarray)
    listed = as_survey(scans)
    T_world_sensor = _rigid(poses) if isinstance(poses, np.ndarray) else poses
    T_world_sensor = T_world_sensor.T_world_sensor if isinstance(T_world_sensor, Trajectory) else T_world_sensor
    if T_world_sensor.single or len(T_world_sensor) != len(listed):
        count = "one" if T_world_sensor.single else len(T_world_sensor)
        raise InputError(f"`poses` has {count} for {len(listed)} scans; wanted a stack with a pose for each scan")
    if voxel is None or not voxel > 0:
        raise InputError(f"`voxel={voxel}` cannot be used; wanted a length in meters above zero, such as 0.5")
    if covariances is not None:
        covariances = as_covariances(covariances, len(listed))
    numbers = as_surveys(surveys, len(listed))
    placed = PlacedScans.of(listed, T_world_sensor, voxel, covariances=covariances, surveys=numbers)
    return clean_map(placed).clean


def _rigid(matrices: "NDArray[Any]") -> RigidTransform:
    try:
        T = RigidTransform.from_matrix(matrices)
    except ValueError as error:
        raise InputError(f"`poses` of shape {matrices.shape} are no poses ({error}); wanted (N, 4, 4)") from error
    if not np.allclose(T.as_matrix(), matrices, rtol=0, atol=_ORTHONORMAL):  # from_matrix corrects rotations
        raise InputError("`poses` have parts [:3, :3] that are no rotations: their rows are not orthonormal")
    return T


def opened_map(folder: Map | str | os.PathLike[str]) -> Map:
    """The map itself, or the map in a folder. Raises InputError: `sonarmap map` did not write the folder."""
    if isinstance(folder, Map):
        return folder
    require_type("folder", [folder], Map, str, os.PathLike)
    return Map.open(folder)
