"""Functions of `import sonarmap`: registration, mapping, localization, comparison, optimization and reading.

In: arrays, scans or paths. Out: the same results as the command line's, as objects.
"""

import os
from collections.abc import Generator, Iterable, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from sonarmap.kernels.errors import InputError
from sonarmap.spectral.grid import Grid, choose_grid
from sonarmap.spectral.result import Registrar, Registration
from sonarmap.spectral.scan import PosePrior, Scan
from sonarmap.tools.given import (
    ScanLike,
    as_paths,
    as_scan,
    as_scans,
    as_survey,
    as_surveys,
    public,
    require,
    require_type,
    with_navigation,
)
from sonarmap.tools.methods.registry import Setup, find_method, reused

if TYPE_CHECKING:
    from sonarmap.slam.execute.runner import Progress
    from sonarmap.slam.graph.control import ControlPoint
    from sonarmap.slam.graph.pose_graph import PoseGraph
    from sonarmap.slam.locate.place import Located
    from sonarmap.slam.locate.surveyed_map import SurveyedMap
    from sonarmap.slam.mapper_settings import MapperSettings
    from sonarmap.slam.motion.odometry import Odometry
    from sonarmap.slam.motion.turn_rates import TurnRates
    from sonarmap.slam.optimize.solve import Optimized, Start
    from sonarmap.slam.survey_result import SurveyResult
    from sonarmap.slam.tie import Tie
    from sonarmap.spectral.registration import SpectralRegistrar
    from sonarmap.tools.files.map_folder.folder import Map
    from sonarmap.tools.products.compare.comparison import Comparison

_MAX_TILT = float(np.deg2rad(35.0))  # the paper's range of roll and pitch (Sect. 2.7)
_EDGE = 128  # of the grid [voxels]


@dataclass(frozen=True, slots=True)
class PreparedScan:
    """A scan prepared once by `prepare` for registration to any other; it may hold device memory.

    Attributes:
        scan: the scan.
        registrar: the method that prepared it; only scans of one `prepare` call can be registered to each other.
        content: the method's prepared form of the scan.
    """

    scan: Scan
    registrar: Registrar
    content: Any


@public
def register(
    target: ScanLike | PreparedScan,
    source: ScanLike | PreparedScan,
    *,
    method: str = "spectral",
    voxel: float | None = None,
    edge: int = _EDGE,
    max_tilt: float = _MAX_TILT,
    device: str | None = None,
    seed: int = 0,
) -> Registration:
    """Register two scans without an initial guess: `T_target_source`, its covariance, and whether to accept it.

    A next call with the same method, edge, tilt, device and seed reuses the tables and the device memory of this one.

    Args:
        target, source: each (N, 3) points of any float type [m, sensor frame: x forward, y left, z up], a `Scan`, or
            the path of a file with one scan; or two scans of one `prepare` call, whose arguments then apply.
        method: name of the method, as in `sonarmap register --method`.
        voxel: edge of a voxel [m]; None to choose it so that the larger scan fills the grid.
        edge: voxels per edge of the grid, an even product of 2, 3 and 5 from 16 to 512.
        max_tilt: largest roll and pitch between the scans [rad]; pi for any.
        device: name of an OpenCL device in `sonarmap devices`, "cpu" or "gpu"; None to choose one.
        seed: seed of methods that draw random numbers.

    Returns:
        p_target = T_target_source p_source [m]; the covariance is (6, 6), rotation first [rad, m], in the body tangent
        of the source (docs/conventions.md).

    Raises:
        InputError: a scan, a file or an argument cannot be used.
        DeviceError: no OpenCL device works, or it is too small for the grid.
    """
    if isinstance(target, PreparedScan) and isinstance(source, PreparedScan):
        if target.registrar is not source.registrar:
            raise InputError("the two scans were prepared by different calls; give both to one call of prepare")
        return target.registrar.register(target.content, source.content)
    if isinstance(target, PreparedScan) or isinstance(source, PreparedScan):
        raise InputError("only one of the two scans is prepared; prepare both in one call, or none")
    require(method=method)
    pair = [as_scan(scan, f"scan {k}") for k, scan in enumerate((target, source))]
    with reused(method, _setup(method, choose_grid(pair, edge, voxel), max_tilt, device, seed)) as registrar:
        return registrar.register(*map(registrar.prepare, pair))


@public
def prepare(
    scans: Iterable[ScanLike],
    *,
    method: str = "spectral",
    voxel: float | None = None,
    edge: int = _EDGE,
    max_tilt: float = _MAX_TILT,
    device: str | None = None,
    seed: int = 0,
) -> list[PreparedScan]:
    """Prepare scans on one grid, so that `register` can register any two of them without repeating that work.

    Args:
        scans: each as in `register`.
        method, voxel, edge, max_tilt, device, seed: as in `register`; the voxel is chosen for the largest scan.

    Raises:
        InputError: a scan, a file or an argument cannot be used.
        DeviceError: no OpenCL device works, or it is too small for the grid.
    """
    require(method=method)
    points = as_scans(scans)
    setup = _setup(method, choose_grid(points, edge, voxel), max_tilt, device, seed)
    registrar = find_method(method).make(setup)
    return [PreparedScan(scan, registrar, registrar.prepare(scan)) for scan in points]


@public
def map_scans(
    scans: Iterable[ScanLike] | str | os.PathLike[str],
    *,
    method: str | Registrar = "spectral",
    voxel: float | None = None,
    edge: int = _EDGE,
    max_tilt: float = _MAX_TILT,
    device: str | None = None,
    seed: int = 0,
    settings: "MapperSettings | None" = None,
    stamps: Sequence[float] | None = None,
    priors: "Sequence[PosePrior | None] | None" = None,
    surveys: Sequence[int] | None = None,
    odometry: "Odometry | None" = None,
    progress: "Progress | None" = None,
    ties: "Sequence[Tie]" = (),
    control: "Sequence[ControlPoint]" = (),
) -> "SurveyResult":
    """Map a survey: poses with covariances, the pose graph, every pair with its verdict, and the fused maps.

    Args:
        scans: at least two, in the order in which they were taken, each as in `register`; or a folder, a file with
            several scans, or a pattern; lines of pings are placed by their navigation. Use `read_scans` for files
            whose ranges, axes or unit need a correction.
        method: the name of a method, or a `Registrar` of your own (`prepare(scan)`, `register(target, source)`).
        voxel, edge, max_tilt, device, seed: as in `register`. With a method of your own, `voxel` is the map's and sets
            the tolerances, and the others are ignored.
        settings: settings of loops, motion, key scans, bridges and the map; None for the defaults.
        stamps: the time of each scan [s]; None for the scans' own stamps.
        priors: the pose that navigation measured for each scan, None for a scan without one; `read_navigation` reads
            them from a file. None for the scans' own priors.
        surveys: the survey number of each scan, ascending; None for one survey, or one for each line of pings.
        odometry: dead reckoning at the scans' times.
        progress: called with (steps done, steps planned so far, text) after each step.
        ties: pairs of scans that you accept, reject or add.
        control: points in scans whose coordinates in the world are known; they put the map into the world frame.

    Raises:
        InputError: fewer than two scans, or a scan, a file or an argument that cannot be used.
        DeviceError: no OpenCL device works, or it is too small for the grid.
    """
    from sonarmap.slam.graph.control import ControlPoint
    from sonarmap.slam.mapper import Mapper
    from sonarmap.slam.mapper_settings import MapperSettings
    from sonarmap.slam.motion.odometry import Odometry
    from sonarmap.slam.survey_grid import survey_grid
    from sonarmap.slam.tie import Tie

    if isinstance(method, type) or not all(hasattr(method, name) for name in ("prepare", "register")):
        require(method=method)
    require_type("settings", [settings], MapperSettings, None)
    require_type("odometry", [odometry], Odometry, None)
    require_type("ties", ties, Tie)
    require_type("control", control, ControlPoint)
    turn_rates = None
    if isinstance(scans, str | os.PathLike):
        survey, odometry, turn_rates, lines = _read_survey(os.fspath(scans), odometry)
        surveys = lines if surveys is None else surveys
    else:
        survey = as_scans(scans)
    survey = with_navigation(survey, stamps, priors)
    numbers = as_surveys(surveys, len(survey))
    grid = survey_grid(survey, edge, voxel)
    if isinstance(method, str):
        method = find_method(method).make(_setup(method, grid, max_tilt, device, seed))
    return Mapper(method, grid.voxel, settings).run(
        survey, progress, numbers, odometry, ties, control, turn_rates=turn_rates
    )


@public
def locate(
    folder: "Map | str | os.PathLike[str]",
    scans: Iterable[ScanLike] | str | os.PathLike[str],
    *,
    alone: bool = False,
    voxel: float | None = None,
    edge: int = _EDGE,
    max_tilt: float = _MAX_TILT,
    device: str | None = None,
) -> "list[Located]":
    """Locate scans in a finished map: `T_map_scan`, its covariance, and whether to accept it.

    Args:
        folder: a folder that `sonarmap map` wrote, or a map; its largest part is searched.
        scans: as in `map_scans`; their priors are in the map's frame, and used only if instruments measured it.
        alone: whether to locate each scan on its own; False for consecutive scans, which support one another.
        voxel, edge, max_tilt, device: as in `register`; the voxel is chosen for views of the map from its scans.

    Returns:
        One result per scan, `located` or not: p_map = T_map_scan p_scan [m]; the covariance is (6, 6), rotation first
        [rad, m], in the body tangent of the scan.

    Raises:
        InputError: the folder, a scan, a file or an argument cannot be used.
        DeviceError: no OpenCL device works, or it is too small for the grid.
    """
    from sonarmap.slam.locate.locator import Locator
    from sonarmap.tools.files.map_folder.folder import surveyed_map
    from sonarmap.tools.maps import opened_map

    surveyed, listed = surveyed_map(opened_map(folder)), as_survey(scans)
    with _for_views(surveyed, edge, voxel, max_tilt, device) as registrar:
        locator = Locator(registrar, surveyed)
        return list(map(locator.locate, listed) if alone else locator.track(listed, [0] * len(listed)))


@public
def compare(
    old: "Map | str | os.PathLike[str] | np.ndarray",
    new: "Map | str | os.PathLike[str] | np.ndarray",
    *,
    same_frame: bool = False,
    reach: float | None = None,
    cloud_sigma: float | None = None,
    voxel: float | None = None,
    edge: int = _EDGE,
    max_tilt: float = _MAX_TILT,
    device: str | None = None,
) -> "Comparison":
    """Compare two surveys of a place: distances with their levels of detection, and the regions that changed.

    Args:
        old, new: folders that `sonarmap map` wrote, or maps; the largest part of each is compared. One of them may be
            a point cloud of another program: its file, or (N, 3) points [m].
        same_frame: whether both are in one frame already: by their georeferences if both have one, otherwise as they
            are. If False, `new` is registered to `old`.
        reach: search distance along the old surface's normal [m]; None for four voxels.
        cloud_sigma: standard deviation of a coordinate of the point cloud [m]; None to estimate it from the scatter.
        voxel, edge, max_tilt, device: as in `register`; the voxel is chosen for views of the map, the old one of two,
            from its scans.

    Returns:
        The comparison in the frame of the old map or of the cloud, as its `notes` say; volumes [m^3] have sigmas.

    Raises:
        InputError: a folder or an argument cannot be used, or the new map cannot be aligned to the old one
            (`NotAlignedError`).
        DeviceError: no OpenCL device works, or it is too small for the grid.
    """
    from sonarmap.tools.files.map_folder.folder import Map, surveyed_map
    from sonarmap.tools.maps import opened_map
    from sonarmap.tools.products.compare.cloud import opened_surveys
    from sonarmap.tools.products.compare.comparison import CompareSettings, compare_maps

    require_type("old", [old], Map, np.ndarray, str, os.PathLike)
    require_type("new", [new], Map, np.ndarray, str, os.PathLike)
    first, second, beside = opened_surveys(old, new, cloud_sigma, opened_map)
    settings = CompareSettings(reach)
    if same_frame:
        return compare_maps(first, second, None, settings)
    with _for_views(surveyed_map(beside), edge, voxel, max_tilt, device) as registrar:
        return compare_maps(first, second, registrar, settings)


@contextmanager
def _for_views(
    surveyed: "SurveyedMap", edge: int, voxel: float | None, max_tilt: float, device: str | None
) -> "Generator[SpectralRegistrar]":
    """Within the block, a registrar with a grid that fits the views of a map from its scans."""
    from sonarmap.slam.survey_grid import survey_grid

    grid = survey_grid(surveyed.key_scans(), edge, voxel)
    with reused("spectral", _setup("spectral", grid, max_tilt, device, 0)) as registrar:
        yield cast("SpectralRegistrar", registrar)


def _read_survey(
    path: str, odometry: "Odometry | None"
) -> "tuple[Sequence[Scan], Odometry | None, TurnRates | None, Sequence[int] | None]":
    """The scans of files, their dead reckoning and turn rates, and, for pings, the number of each scan's line."""
    from sonarmap.tools.files.readers.navigation.odometry import turn_rates_of
    from sonarmap.tools.files.readers.pings.line_file import as_survey
    from sonarmap.tools.files.readers.scans import read_scans as read

    files = read([path])
    survey, odometry = as_survey(files.scans, files.patches, odometry)
    return survey, odometry, turn_rates_of(files.files, survey), files.surveys if files.patches else None


@public
def optimize(
    graph: "PoseGraph | str | os.PathLike[str]",
    *,
    start: "Start" = "chordal",
    robust: bool = False,
) -> "Optimized":
    """Optimize a pose graph: find the poses that agree best with its edges.

    Args:
        graph: a connected graph, or the path of a g2o file or of a map's graph.json.
        start: "chordal", from the edges alone; "given", from the graph's poses.
        robust: whether to reject wrong edges first.

    Raises:
        InputError: the file, the graph or an argument cannot be used, or the equations have no unique solution.
    """
    from pathlib import Path

    from sonarmap.slam.graph.pose_graph import PoseGraph
    from sonarmap.slam.optimize.solve import optimize as optimize_graph
    from sonarmap.tools.files.readers.g2o import read_g2o, require_connected
    from sonarmap.tools.files.readers.trajectory import read_graph_json

    if not isinstance(graph, PoseGraph):
        require(graph=graph)
        path = Path(graph)
        graph = read_graph_json(path) if path.suffix == ".json" else read_g2o(path)
        require_connected(path, graph)
    return optimize_graph(graph, start, robust)


@public
def read_scans(
    *paths: str | os.PathLike[str],
    sound_speed: float | None = None,
    range_scale: float = 1.0,
    frame: str | None = None,
    units: str | None = None,
    min_range: float = 0.05,
    max_range: float | None = None,
    exclude_box: Sequence[Sequence[float]] = (),
) -> list[Scan]:
    """Read every scan of files, folders and patterns, in natural order of their names, as `sonarmap map` does.

    Args:
        paths: PLY, PCD, XYZ/TXT/CSV/PTS/ASC, NPY, NPZ, LAS, LAZ and .sonar files, ROS bags and MCAP files, folders and
            patterns; `recording.sonar#3` is one scan of a file with several, `dive.bag::/sonar/points` one topic.
        sound_speed: true speed of sound [m/s]; the ranges of each scan of a .sonar file are multiplied by its ratio to
            the recorded one. None if the recorded one is right.
        range_scale: another factor on the ranges, for files of any format.
        frame: directions of x, y, z of the points in the files, a letter each, as in `--frame`: "flu" (forward, left,
            up), "frd", "rdf", "ned" and so on; None for what the file says, as by the name of a frame, and "flu" for
            others.
        units: unit of the points in the files, as in `--units`: "m", "cm", "mm", "ft" or "us-ft"; None for meters,
            if the points look like these.
        min_range: points at this distance from the sensor or nearer are left out [m], as no returns.
        max_range: points farther from the sensor are left out [m]; None for no limit.
        exclude_box: boxes whose points are left out, as of a skid; each is x, y, z of two corners in the sensor's frame
            [m].

    Returns:
        Scans with points in meters: x forward, y left, z up, or East, North, up with frame "ned".

    Raises:
        InputError: a file cannot be read (the message names its line or packet, if it has one); or an argument cannot
            be used, in general or with a file's format.
    """
    from sonarmap.tools.files.readers.clouds.cloud import Bounds
    from sonarmap.tools.files.readers.scans import Corrections, PointFrame
    from sonarmap.tools.files.readers.scans import read_scans as read

    names = as_paths("paths", paths)
    bounds = Bounds.of(min_range, max_range, exclude_box)
    corrections = Corrections(sound_speed, range_scale, PointFrame(frame, units), bounds=bounds)
    return list(read(names, corrections).scans)


def _setup(method: str, grid: Grid, max_tilt: float, device: str | None, seed: int) -> Setup:
    changes = {"max_tilt": max_tilt} if "max_tilt" in find_method(method).options else {}
    return Setup(grid, device, seed, changes)
