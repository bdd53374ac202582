"""Reading the folder that `sonarmap map` wrote."""

import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import RigidTransform

from sonarmap.kernels.counted import counted
from sonarmap.kernels.errors import InputError
from sonarmap.slam.graph.gauge import MEASURED
from sonarmap.slam.graph.tangent import sigma_words, upward
from sonarmap.slam.graph.trajectory import Trajectory
from sonarmap.slam.locate.surveyed_map import SurveyedMap
from sonarmap.slam.map.placed import pose_variance
from sonarmap.slam.map.surface import on_surface
from sonarmap.slam.motion.straighten import straightened
from sonarmap.slam.pings.biases import Biases
from sonarmap.spectral.scan import Scan
from sonarmap.tools.files.geo import DEFAULT_VERTICAL, Georeference
from sonarmap.tools.files.map_folder.names import FULL_GRAPH, as_written, require_own
from sonarmap.tools.files.readers.clouds.cloud import Bounds
from sonarmap.tools.files.readers.clouds.ply import read_ply_columns
from sonarmap.tools.files.readers.csv_table import SUMMARY
from sonarmap.tools.files.readers.instruments import LARGEST
from sonarmap.tools.files.readers.navigation.odometry import turn_rates_of
from sonarmap.tools.files.readers.pings.line_file import LineReading
from sonarmap.tools.files.readers.scans import Corrections, PointFrame, ReadScans, read_survey
from sonarmap.tools.files.readers.trajectory import trajectory_of
from sonarmap.tools.files.user_file import input_rows, naming, read_content, read_json

COLUMNS = ("count", "seen", "sigma", "scan", "survey")  # columns of every map.ply
_ELSEWHERE = "say where the scans are now with --scans-from PATH"


@dataclass(frozen=True, slots=True)
class MapPart:
    """One map of the folder: n scans that share a frame.

    Attributes:
        suffix: of its files' names: empty for the largest, then _2 and so on.
        points: (M, 3) float64 [m], in the part's frame.
        columns: {name: (M,)}, the other properties of points in map.ply: COLUMNS, and perhaps intensity.
        scans: indices of its scans in the survey, ascending.
        trajectory: poses T_world_sensor and stamps [s] of the n scans.
        covariances: (n, 6, 6) of the poses, rotation first [rad, m], body tangent.
        in_world: whether instruments constrain the frame at all; it is East-North-Up then.
        unmeasured: names of `slam.graph.gauge.MEASURED` that no instrument constrains.
    """

    suffix: str
    points: np.ndarray
    columns: Mapping[str, np.ndarray]
    scans: tuple[int, ...]
    trajectory: Trajectory
    covariances: np.ndarray
    in_world: bool
    unmeasured: tuple[str, ...] = ()

    @property
    def point_stamps(self) -> np.ndarray:
        """Stamp (M,) float64 [s] of the scan that contributed most to each point."""
        return self.trajectory.stamps[np.searchsorted(self.scans, self.columns["scan"])]

    @property
    def height_sigma(self) -> np.ndarray:
        """Standard deviation (M,) float64 of each point's height [m]: the vertical part of `sigma`, which is the root
        mean square over three axes of the errors due to poses and ranges."""
        scan = np.searchsorted(self.scans, self.columns["scan"])
        T, total = self.trajectory.T_world_sensor[scan], self.columns["sigma"].astype(np.float64) ** 2
        J, by_poses = upward(T, self.points), np.empty(len(scan))
        beams = T.inv().apply(self.points)
        for pose in np.unique(scan).tolist():
            by_poses[scan == pose] = pose_variance(beams[scan == pose], self.covariances[pose])
        along_z = np.einsum("na,nab,nb->n", J, self.covariances[scan], J)
        steep = (np.einsum("na,na->n", beams, J[:, 3:]) / np.maximum(np.linalg.norm(beams, axis=1), 1e-12)) ** 2
        share = np.minimum(total / np.maximum(by_poses, 1e-30), 1.0)  # below 1 where averaging scans lowers the error
        return np.sqrt(share * along_z + 3 * steep * np.maximum(total - by_poses, 0.0))

    def take(self, chosen: np.ndarray) -> "MapPart":
        """The part with only the `chosen` points, (M,) bool."""
        columns = {name: column[chosen] for name, column in self.columns.items()}
        return replace(self, points=self.points[chosen], columns=columns)

    def knows(self, what: str) -> bool:
        """Whether instruments constrain the quantity `what`, a name of `MEASURED`, of the frame."""
        return self.in_world and what not in self.unmeasured

    @property
    def placed(self) -> bool:
        """Whether instruments constrain the frame's position and heading completely."""
        return self.in_world and not self.unmeasured


@dataclass(frozen=True, slots=True)
class Loop:
    """A loop closure candidate between two scans of the survey, and whether it was kept."""

    target: int
    source: int
    kept: bool
    reason: str


@dataclass(frozen=True, slots=True, repr=False)
class Map:
    """A finished map: the folder that `sonarmap map` or `write_map` wrote.

    Attributes:
        path: of the folder.
        names: of the N scans of the survey.
        parts: the maps, largest first, each with its points, columns, poses and their covariances.
        loops: all loop closure candidates.
        voxel: edge of a voxel of the maps [m].
        summary: content of summary.json.
        georeference: of the frame of the parts that instruments placed, or else of the first part; None if it is
            unknown.
        graph: content of graph.json.
    """

    path: Path
    names: tuple[str, ...]
    parts: tuple[MapPart, ...]
    loops: tuple[Loop, ...]
    voxel: float
    summary: Mapping[str, Any]
    georeference: Georeference | None
    graph: Mapping[str, Any]

    @classmethod
    def open(cls, folder: str | os.PathLike[str]) -> "Map":
        """Read the map in a folder.

        Raises:
            InputError: `sonarmap map` or `write_map` did not write the folder, or files are missing or damaged.
        """
        return read_map_folder(Path(folder))

    def __repr__(self) -> str:
        return f"<Map {self.path}: {counted(len(self.names), 'scan')} in {counted(len(self.parts), 'part')}>"

    def __str__(self) -> str:
        placed, points = sum(len(part.scans) for part in self.parts), sum(len(part.points) for part in self.parts)
        sigmas = sigma_words(np.concatenate([part.covariances for part in self.parts]))
        here = self.georeference
        where = "not known" if here is None else f"{here.latitude:.6f}, {here.longitude:.6f}, height {here.height:g} m"
        return (
            f"{self.path}: {counted(points, 'point')} in {counted(len(self.parts), 'part')}, "
            f"voxels of {self.voxel:.3g} m\n"
            f"  {placed} of {counted(len(self.names), 'scan')} placed, sigmas up to {sigmas}\n"
            f"  place on the Earth: {where}"
        )

    def on_earth(self, part: MapPart) -> bool:
        is_first = part is self.parts[0] and not any(other.placed for other in self.parts)
        return self.georeference is not None and (part.placed or is_first)

    def surface(self, part: MapPart) -> MapPart:
        """The part without stray echoes, for products of surfaces: grids, contours, meshes, sections, volumes."""
        return part.take(on_surface(part.points, self.voxel))

    def surveys(self, part: MapPart) -> list[int]:
        """The survey index of each scan of the part; 0 for all if summary.json has no list of scans.

        Raises InputError: the list lacks the survey of a scan."""
        rows = self.summary.get("scans")
        if not rows:
            return [0] * len(part.scans)
        try:
            return [int(rows[scan]["survey"]) for scan in part.scans]
        except (LookupError, TypeError, ValueError) as error:
            raise InputError(f"{self.path / SUMMARY} lacks the surveys of the scans; run map again") from error


def read_map_folder(path: Path) -> Map:
    """Read the map in a folder. Raises InputError: `sonarmap map` did not write the folder, or files are missing or
    damaged."""
    expected = "the folder that `sonarmap map` wrote"
    if not path.is_dir():
        raise InputError(f"{path} is not a folder; wanted {expected}")
    if not (path / SUMMARY).exists():
        raise InputError(f"{path} holds no map: it has no {SUMMARY}; wanted {expected}")
    summary = read_json(path / SUMMARY, f"a file of {expected}")
    with as_written(path):
        _require_types(summary)
        rows = summary["components"]
        suffixes = ["" if rank == 1 else f"_{rank}" for rank in range(1, len(rows) + 1)]
        require_own(path, summary, [FULL_GRAPH, *(f"map{suffix}.ply" for suffix in suffixes)])
        graph = read_json(path / FULL_GRAPH, f"a file of {expected}")
        poses = graph["poses"]
        with naming(path / FULL_GRAPH):
            trajectory = trajectory_of(poses)
        covariances = np.array([pose["covariance"] for pose in poses], dtype=np.float64).reshape(-1, 6, 6)
        parts = []
        for suffix, row in zip(suffixes, rows, strict=True):
            scans = tuple(int(scan) for scan in row["scans"])
            cloud = map_points(path / f"map{suffix}.ply", scans)
            placed = trajectory.take(scans), covariances[list(scans)], bool(poses[scans[0]]["in_world"])
            if not np.isfinite(placed[1]).all():  # null is NaN
                raise ValueError("a covariance that is not finite")
            parts.append(MapPart(suffix, *cloud, scans, *placed, tuple(str(name) for name in row["unmeasured"])))
        where = summary.get("georeference")
        with naming(path / SUMMARY):
            here = None if where is None else Georeference.of_json(where)
        return Map(
            path=path,
            names=tuple(str(pose["name"]) for pose in poses),
            parts=tuple(parts),
            loops=tuple(
                Loop(int(pair["target"]), int(pair["source"]), bool(pair["kept"]), str(pair["reason"]))
                for pair in graph["pairs"]
                if pair["role"] == "loop"
            ),
            voxel=float(rows[0]["map"]["voxel_m"]),
            summary=summary,
            georeference=here,
            graph=graph,
        )


def _require_types(summary: Any) -> None:
    """Raise TypeError if file names or SHA-256 in summary.json are not texts, as callers rely on this."""
    settings, inputs = summary.get("settings") or {}, summary.get("inputs") or []
    texts = [*summary.get("files", []), *(settings.get("inputs") or []), *(row["sha256"] or "" for row in inputs)]
    if wrong := [text for text in texts if not isinstance(text, str)]:
        raise TypeError(f"{wrong[0]!r} where the name or the SHA-256 of a file belongs")


def map_points(path: Path, scans: Sequence[int]) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """Points (M, 3) float64 [m] and columns of a map.ply made of `scans`. Raises InputError: missing or damaged."""
    content = read_content(path)
    with naming(path):
        columns = read_ply_columns(content)
    if missing := [name for name in (*"xyz", *COLUMNS) if name not in columns]:
        raise InputError(f"{path} has no column {missing[0]!r}; wanted a map that `sonarmap map` wrote")
    points = np.column_stack([columns.pop(axis).astype(np.float64) for axis in "xyz"])
    usable = (np.abs(points) <= LARGEST).all() and np.isin(columns["scan"], scans).all()
    if not (usable and all((columns[name] >= 0).all() for name in COLUMNS)):  # NaN is not
        raise InputError(f"{path} holds scans, coordinates or counts that cannot be; it is damaged: map again")
    return points, columns


def surveyed_map(folder: Map) -> SurveyedMap:
    """The largest part of the map, with its points and the poses of its scans, for localization."""
    part = folder.parts[0]
    return SurveyedMap(
        points=part.points,
        seen_by=np.searchsorted(part.scans, part.columns["scan"]),
        T_map_sensor=part.trajectory.T_world_sensor,
        covariances=part.covariances,
        voxel=folder.voxel,
        measured=np.array([part.knows(name) for name in MEASURED]),
    )


def mapped_scans(
    folder: Map, paths: Sequence[str] = (), progress: Callable[[int, int, str], None] | None = None
) -> tuple[Scan, ...]:
    """Read the N scans of a map again, with the map's corrections and straightening. Large surveys are kept on disk.

    Args:
        folder: the map.
        paths: the scans' files; by default the paths that `map` was given, relative to the current folder.
        progress: see `read_survey`.

    Raises:
        InputError: the map's summary does not name its scans, or their files are missing or changed.
    """
    settings: dict[str, Any] = folder.summary.get("settings") or {}
    inputs: list[str] | None = list(paths) or settings.get("inputs")
    if not inputs:
        raise InputError(f"{folder.path / SUMMARY} does not say where the map's scans are; {_ELSEWHERE}")
    with as_written(folder.path):
        corrections = _corrections(settings)
    try:
        read = read_survey(inputs, (), progress, corrections)
    except InputError as error:
        raise InputError(f"cannot read the scans again to get their points: {error}; {_ELSEWHERE}") from error
    _require_same(folder, read)
    with as_written(folder.path):
        return _straight(folder, read)


def _corrections(settings: dict[str, Any]) -> Corrections:
    """The corrections of points that the map's settings describe."""
    biases = Biases.of_json(settings["patch_test"]) if "patch_test" in settings else Biases()
    frame = PointFrame(settings.get("frame"), settings.get("units"))
    lines = LineReading(
        settings.get("patch"),
        biases,
        settings.get("draught") or 0.0,
        settings.get("all_soundings") or False,
        settings.get("heights", DEFAULT_VERTICAL),
    )
    bounds = Bounds.of(settings.get("min_range"), settings.get("max_range"), settings.get("exclude_box", []))
    return Corrections(settings.get("sound_speed"), settings.get("range_scale", 1.0), frame, lines, bounds)


def _require_same(folder: Map, read: ReadScans) -> None:
    """Raise InputError if the SHA-256 of the files or the number of scans differ from the map's inputs."""
    recorded = [row["sha256"] for row in folder.summary.get("inputs") or ()]
    files = [row["sha256"] for row in input_rows(read.files)]
    if files != recorded[: len(files)] or len(read.scans) != len(folder.names):
        raise InputError(
            f"{read.files[0].parent} holds other scans than {folder.path} was made of; {_ELSEWHERE}, or map again"
        )


def _straight(folder: Map, read: ReadScans) -> tuple[Scan, ...]:
    """The scans, corrected for the sensor's motion during each scan if the map's scans were."""
    if not folder.summary.get("straightened"):
        return read.scans
    if (motion := folder.graph.get("straightened_by")) is None:
        raise InputError(f"{folder.path} does not say how its scans were straightened; map again with this version")
    T = RigidTransform.from_matrix(np.array(motion["T_world_sensor"], np.float64))
    before = Trajectory(np.array([pose["stamp"] for pose in folder.graph["poses"]], np.float64), T)
    turn_rates = turn_rates_of(read.files, read.scans) if motion["turned"] else None
    return straightened(read.scans, before, motion["runs"], folder.voxel / 2, motion["bent"], turn_rates).scans
