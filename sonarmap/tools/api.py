"""What `import sonarmap` offers beside the classes of the rooms: registration, mapping, optimizing and reading.

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
    from sonarmap.slam.mapper import MapperSettings
    from sonarmap.slam.motion.odometry import Odometry
    from sonarmap.slam.motion.turn_rates import TurnRates
    from sonarmap.slam.optimize.solve import Objective, Optimized, Start
    from sonarmap.slam.survey_result import SurveyResult
    from sonarmap.slam.tie import Tie
    from sonarmap.spectral.registration import SpectralRegistrar
    from sonarmap.tools.files.map_folder.folder import Map
    from sonarmap.tools.products.compare.comparison import Comparison

_MAX_TILT = float(np.deg2rad(35.0))  # the paper's range of roll and pitch (Sect. 2.7)
_EDGE = 128


@dataclass(frozen=True, slots=True)
class PreparedScan:
    """A scan with everything that every pair of it needs, computed once by `prepare`; it may hold device memory.

    Attributes:
        scan: the scan.
        registrar: the method that prepared it; only scans of the same `prepare` can be registered to each other.
        content: what the method made of it.
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

    The next call with the same method, edge, tilt, device and seed uses the tables and the device memory of this one.

    Args:
        target, source: each (N, 3) points of any float type [m, sensor frame: x forward, y left, z up], a `Scan`, or
            the path of a file with one scan; or two scans of one `prepare`, whose arguments then count.
        method: its name, as `sonarmap register --method` takes it.
        voxel: edge of a voxel [m]; None for the one with which the larger scan fills the grid.
        edge: voxels per edge of the grid, an even product of 2, 3 and 5 from 16 to 512.
        max_tilt: largest roll and pitch between the scans [rad]; pi for any.
        device: the OpenCL device as `sonarmap devices` lists it, "cpu" or "gpu"; None chooses one.
        seed: of methods that draw at random.

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
    """Prepare scans once, to register any two of them with `register`; they share one grid.

    Args:
        scans: each as `register` takes it.
        method, voxel, edge, max_tilt, device, seed: as of `register`; the voxel is chosen for the largest scan.

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
        scans: at least two, in the order in which they were taken, each as `register` takes it; or a folder, a file
            with several scans, or a pattern; lines of pings are placed by their navigation. `read_scans` reads files
            whose ranges, axes or unit need a correction.
        method: the name of a method, or a `Registrar` of your own (`prepare(scan)`, `register(target, source)`).
        voxel, edge, max_tilt, device, seed: as of `register`. With a method of your own `voxel` is the map's and sets
            the tolerances, and the others are ignored.
        settings: of loops, motion, key scans, bridges and the map.
        stamps: the time of each scan [s], in place of its own.
        priors: what navigation measured of each scan's pose, in place of its own; None where it measured nothing.
            `read_navigation` reads it from a file.
        surveys: the number of each scan's survey, ascending; all are of one by default.
        odometry: dead reckoning of the scans.
        progress: called with (steps done, steps planned so far, text) after each step.
        ties: pairs that you accept, reject or add.
        control: points of scans with known coordinates, which bring the map into the world.

    Raises:
        InputError: fewer than two scans, or a scan, a file or an argument that cannot be used.
        DeviceError: no OpenCL device works, or it is too small for the grid.
    """
    from sonarmap.slam.graph.control import ControlPoint
    from sonarmap.slam.mapper import Mapper, MapperSettings
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
    """Where scans were taken in a finished map: `T_map_scan`, its covariance, and whether to believe it.

    Args:
        folder: that `sonarmap map` wrote, or a map; its largest part is searched.
        scans: as `map_scans` takes them; a scan's prior counts where instruments placed the map, and is in its frame.
        alone: whether the scans do not follow one another.
        voxel, edge, max_tilt, device: as of `register`; the voxel is chosen for the map as its scans saw it.

    Returns:
        of each scan, also of one that is not `located`: p_map = T_map_scan p_scan [m]; the covariance is (6, 6),
        rotation first [rad, m], in the body tangent of the scan.

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
    """What changed between two surveys of a place: distances with their levels of detection, and regions that changed.

    Args:
        old, new: folders that `sonarmap map` wrote, or maps; the largest part of each counts. One of them may be a
            point cloud of another program: its file, or (N, 3) points [m].
        same_frame: whether both are in one frame, so that nothing is registered: by their places on the Earth where
            both have one, else as they are. Otherwise `new` is registered to `old`.
        reach: search distance along the old surface's normal [m]; None for four voxels.
        cloud_sigma: standard deviation of a coordinate of the point cloud [m]; None for what its scatter says.
        voxel, edge, max_tilt, device: as of `register`; the voxel is chosen for the map, the old one of two, as its
            scans saw it.

    Returns:
        in the frame of the old map, or of the cloud, as `notes` say; volumes of regions [m^3] have standard deviations.

    Raises:
        InputError: a folder or an argument cannot be used, or the new map was not found in the old one
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
    """Within the block, who registers to views of a map, on the grid that suits them."""
    from sonarmap.slam.survey_grid import survey_grid

    grid = survey_grid(surveyed.key_scans(), edge, voxel)
    with reused("spectral", _setup("spectral", grid, max_tilt, device, 0)) as registrar:
        yield cast("SpectralRegistrar", registrar)


def _read_survey(
    path: str, odometry: "Odometry | None"
) -> "tuple[Sequence[Scan], Odometry | None, TurnRates | None, Sequence[int] | None]":
    """The scans of files, dead reckoning and turn rates of them, and which are of one line where they are of pings."""
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
    objective: "Objective" = "full",
    start: "Start" = "chordal",
    robust: bool = False,
) -> "Optimized":
    """The poses that agree best with the edges of a pose graph.

    Args:
        graph: connected, or the path of a g2o file or of a map's graph.json.
        objective: "full", chi-squared with the edges' whole information; "isotropic", one weight for an edge's rotation
            and one for its translation, whose optimum a certificate judges.
        start: "chordal", from the edges alone; "given", from the graph's poses.
        robust: whether to look for wrong edges first, and leave them out.

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
    return optimize_graph(graph, objective, start, robust)


@public
def read_scans(
    *paths: str | os.PathLike[str],
    sound_speed: float | None = None,
    range_scale: float = 1.0,
    frame: str = "flu",
    units: str = "m",
) -> list[Scan]:
    """Every scan of the files, folders and patterns, in natural order of their names, as `sonarmap map` reads them.

    Args:
        paths: PLY, PCD, XYZ/TXT/CSV, NPY, NPZ, LAS, LAZ and .sonar files, ROS bags and MCAP files, folders and
            patterns; `recording.sonar#3` is one scan of a file with several, `dive.bag::/sonar/points` one topic.
        sound_speed: the right one [m/s]; the ranges of each scan of a .sonar file are multiplied by its ratio to the
            recorded one. None: they are right.
        range_scale: a factor on the ranges besides, without a unit, of any format.
        frame: axes of the points in the files, as of `--frame`: "flu", "frd", "rdf" or "ned".
        units: of the points in the files, as of `--units`: "m", "cm", "mm", "ft" or "us-ft".

    Returns:
        Scans with points in meters, x forward, y left, z up; East, North, up of files with frame "ned".

    Raises:
        InputError: naming the file and, where it applies, its line or packet; or an argument that cannot be used, or
            not with a file's format.
    """
    from sonarmap.tools.files.readers.scans import Corrections, PointFrame
    from sonarmap.tools.files.readers.scans import read_scans as read

    names = as_paths("paths", paths)
    corrections = Corrections(sound_speed, range_scale, PointFrame(frame, units))
    return list(read(names, corrections).scans)


def _setup(method: str, grid: Grid, max_tilt: float, device: str | None, seed: int) -> Setup:
    changes = {"max_tilt": max_tilt} if "max_tilt" in find_method(method).options else {}
    return Setup(grid, device, seed, changes)
