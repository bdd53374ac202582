"""The content of a point cloud file, and its conversion to a scan of the usable points."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Self

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from sonarmap.kernels.errors import InputError
from sonarmap.spectral.scan import PosePrior, Scan
from sonarmap.tools.files.geo import DEFAULT_VERTICAL

STRENGTH_NAMES = ("strength", "intensity", "amplitude", "reflectivity", "i")
VIEWPOINT_NAMES = ("vp_x", "vp_y", "vp_z")  # as in PCL's PointWithViewpoint
TIME_NAMES = ("gps_time", "gpstime", "timestamp", "time", "t")

LONGITUDES = {"lon", "lng", "long", "longitude", "lon_deg"}
DEGREES = (
    "longitudes and latitudes in degrees are not a scan; project them to meters, as to the UTM zone with QGIS or PDAL, "
    "and subtract the sensor's position from the points of each scan"
)

_LISTED = 300  # characters of names that a message lists

# Sensors see hundreds of meters; larger coordinates are map coordinates, whose centimeters float32 would lose.
COORDINATE_LIMIT = 1e5
_LONGEST_SCAN = 3600.0  # [s]
_AWAY = 5.0  # points are map coordinates if their median is farther from the origin than their extent times this
_MAX_MEDIAN = 2000.0  # largest median coordinate of points in meters [m]: 3D sonars see a few hundred meters at most
_MAX_WHOLE = 100.0  # the same of points that are all whole numbers, which measured meters are not
# Largest extent of degrees along x and y, and how many times farther the points are from 0, and extend along z
_MAX_DEGREES, _LEAST_RATIO = 0.1, 50.0
POINT_BYTES = 3 * 8  # memory of a point while it is checked


@dataclass(frozen=True, slots=True)
class PingPatch:
    """The survey line of which a scan is a patch, and the patch's pose by the line's navigation."""

    path: Path  # file of the line
    middle: int  # index of the ping whose transducer frame is the scan's frame
    count: int  # number of patches of the line
    depth: float  # median depth of the soundings below the transducer [m]
    geodetic: tuple[float, float, float]  # latitude, longitude [deg], height [m] of the scan's frame
    R_north_patch: Rotation  # orientation in local East, North, Up
    below_water: bool = True  # whether heights are relative to the water surface, not to the transducer
    vertical: str = DEFAULT_VERTICAL  # vertical reference of the height, if that is not the transducer


@dataclass(frozen=True, slots=True)
class Cloud:
    """One cloud as its file holds it, not yet checked."""

    points: np.ndarray  # (N, 3), integer or floating [m]; NaN and inf allowed
    strength: np.ndarray | None = None  # (N,), integer or floating, linear, or None
    stamp: float | None = None  # time [s, UTC], or None where the file carries none
    notes: tuple[str, ...] = field(default=())  # messages for the user about this cloud
    # (N, 3), position of the sensor when it measured each point [m], in the points' frame, or None
    viewpoints: np.ndarray | None = None
    times: np.ndarray | None = None  # (N,), time at which each point was measured [s], or None
    prior: PosePrior | None = None  # pose measured by the sensor's own instruments, or None
    sound_speed: float | None = None  # speed of sound with which the sensor computed ranges [m/s], or None
    patch: PingPatch | None = None  # the pings of a line it is made of, or None
    axes: str = "flu"  # of the points by the file, a name for `axes_matrix`
    question: str = ""  # why these axes may be others, and what to do
    T_base_flu: RigidTransform | None = None  # from the sensor (x forward, y left, z up) to the scan's frame


def column_roles(names: Sequence[str]) -> dict[str, int]:
    """Indices {role: index} of the columns x, y, z and, if present, strength, vp_x, vp_y, vp_z and time. Names may have
    any case, with or without CloudCompare's prefix `scalar_`."""
    plain = [name.lower().removeprefix("scalar_") for name in names]
    missing = [axis for axis in "xyz" if axis not in plain]
    if missing:
        listed = ", ".join(names) or "(none)"
        listed = listed if len(listed) <= _LISTED else f"{listed[:_LISTED]}..."
        if LONGITUDES.intersection(plain):
            raise InputError(f"its columns are {listed}: {DEGREES}")
        raise InputError(f"no column {', '.join(missing)} among the columns {listed}; name the coordinates x, y and z")
    roles = {axis: plain.index(axis) for axis in "xyz"}
    seen_from = [name for name in VIEWPOINT_NAMES if name in plain]
    if 0 < len(seen_from) < 3:
        raise InputError(f"of {', '.join(VIEWPOINT_NAMES)} there is only {' and '.join(seen_from)}; give all or none")
    roles |= {name: plain.index(name) for name in seen_from}
    for role, known in (("strength", STRENGTH_NAMES), ("time", TIME_NAMES)):
        name = next((name for name in known if name in plain), None)
        roles |= {} if name is None else {role: plain.index(name)}
    return roles


def cloud_of_columns(columns: Mapping[str, np.ndarray], notes: Sequence[str] = ()) -> Cloud:
    """The cloud of columns {role: (N,)} with the roles of `column_roles`; other columns are ignored."""
    with np.errstate(invalid="ignore"):  # a signaling NaN is dropped later like any other
        points = np.stack([columns[axis] for axis in "xyz"], axis=1)
    seen_from = [columns[name] for name in VIEWPOINT_NAMES if name in columns]
    viewpoints = np.stack(seen_from, axis=1) if seen_from else None
    return Cloud(points, columns.get("strength"), notes=tuple(notes), viewpoints=viewpoints, times=columns.get("time"))


def columns_of(scan: Scan) -> dict[str, np.ndarray]:
    """Columns {name: (N,)} for `write_ply`: intensity, time and vp_x, vp_y, vp_z, if the scan has them."""
    columns = {} if scan.strength is None else {"intensity": scan.strength}
    if scan.times is not None:
        columns["time"] = scan.times
    if scan.viewpoints is not None:
        columns |= dict(zip(VIEWPOINT_NAMES, scan.viewpoints.T, strict=True))
    return columns


@dataclass(frozen=True, slots=True)
class Note:
    """A message about the points of a scan, whose counts are summed over the scans of which it is true."""

    words: str  # with {} for the counts
    count: int = 0
    total: int = 0

    def __str__(self) -> str:
        return self.words.replace("{}", f"{self.count:,} of {self.total:,}") if self.total else self.words


@dataclass(frozen=True, slots=True)
class Bounds:
    """Which points of a scan are used."""

    # smallest and largest distance from the sensor [m]. Nearer points are no returns: sonars write these as 0, 0, 0, or
    # as a ring of the shortest range
    min_range: float = 0.05
    max_range: float = math.inf
    boxes: tuple[tuple[float, ...], ...] = ()  # x, y, z of two opposite corners of each [m]; points inside are left out

    @classmethod
    def of(cls, min_range: float | None, max_range: float | None, boxes: str | Sequence[str | Sequence[float]]) -> Self:
        """Bounds with defaults for None; a box is six numbers, or a text of these with commas."""
        least, most = cls().min_range if min_range is None else min_range, math.inf if max_range is None else max_range
        if not 0 <= least < most:
            raise InputError(f"ranges from {least:g} to {most:g} m leave nothing; give other --min-range, --max-range")
        corners = []
        for box in [boxes] if isinstance(boxes, str) else boxes:
            numbers = box.split(",") if isinstance(box, str) else box
            try:
                corners.append(tuple(float(number) for number in numbers))
            except (TypeError, ValueError):
                corners.append(())
            if len(corners[-1]) != 6 or not np.isfinite(corners[-1]).all():
                wanted = "x, y, z of two corners [m], as in --exclude-box 0.7,-0.4,-0.3,1.2,0.4,0.1"
                raise InputError(f"--exclude-box {box!r} is no box; wanted {wanted}")
        return cls(least, most, tuple(corners))

    def excluded(self, points: np.ndarray, viewpoints: np.ndarray | None) -> list[tuple[str, np.ndarray]]:
        """What is excluded, in words, with (N,) bool which of the points (N, 3) [m]; no comparison holds for NaN."""
        with np.errstate(invalid="ignore", over="ignore"):
            beams = points if viewpoints is None else points - viewpoints
            squares = np.einsum("ij,ij->i", beams, beams)
        near = f"within {100 * self.min_range:g} cm of the sensor, which are no returns"
        x, y, z = points.T
        at_sensor = (squares <= self.min_range**2) | ((x == 0) & (y == 0) & (z == 0))
        excluded = [(near, at_sensor), (f"beyond {self.max_range:g} m", squares > self.max_range**2)]
        for box in self.boxes:
            low, high = np.sort(np.reshape(box, (2, 3)), axis=0)
            words = f"in the excluded box {','.join(f'{x:g}' for x in box)}"
            excluded.append((words, ((points >= low) & (points <= high)).all(axis=1)))
        return excluded


RETURNS = Bounds()


def scan_of_cloud(cloud: Cloud, name: str, stamp: float, bounds: Bounds = RETURNS) -> tuple[Scan, list[Note]]:
    """The usable points of `cloud` as a scan, and notes about dropped points and corrected strengths: points that are
    NaN, infinite or out of bounds are dropped; strengths that are negative, NaN or infinite become 0."""
    notes = [Note(note) for note in cloud.notes]
    total = len(cloud.points)
    if total == 0:
        raise InputError("no points in it; give a scan with at least one finite point")
    with np.errstate(invalid="ignore"):
        points = cloud.points.astype(np.float64)
    finite = np.isfinite(points)
    finite = np.ones(total, bool) if finite.all() else finite.all(axis=1)  # all(axis=1) takes ten times as long
    kept = np.ones(total, bool)
    for words, wrong in (("that are NaN or infinite", ~finite), *bounds.excluded(points, cloud.viewpoints)):
        if dropped := int((kept & wrong).sum()):
            notes.append(Note(f"dropped {{}} points {words}", dropped, total))
            kept &= ~wrong
    if not kept.any():
        reasons = ", ".join(str(note) for note in notes if note.total)
        raise InputError(f"{reasons}; nothing is left to register")
    points = points[kept]
    refuse_map_coordinates(points)
    strength = None
    if cloud.strength is not None:
        strength, corrected = _usable_strength(cloud.strength[kept])
        if corrected:
            notes.append(Note("set {} strengths that are negative or not finite to 0", corrected, len(strength)))
    viewpoints = None if cloud.viewpoints is None else _usable_viewpoints(cloud.viewpoints[kept])
    times = _times_after(cloud, kept)
    return Scan(points.astype(np.float32), strength, stamp, cloud.prior, name, viewpoints, times), notes


def _times_after(cloud: Cloud, chosen: np.ndarray) -> np.ndarray | None:
    """Times (N,) float32 [s] of the chosen points after the cloud's stamp, or after its first point. None if they are
    unknown or all equal, or if the points are already compensated for the sensor's motion (several viewpoints)."""
    viewpoints = cloud.viewpoints
    if cloud.times is None or (viewpoints is not None and np.ptp(viewpoints, axis=0).any()):
        return None
    times = cloud.times[chosen].astype(np.float64)
    if not np.isfinite(times).all() or (times == times[0]).all():
        return None
    start = 0.0 if cloud.stamp is None else cloud.stamp
    if np.abs(times - start).max() > _LONGEST_SCAN:  # of another clock
        start = times.min()
    with np.errstate(over="ignore"):
        after = (times - start).astype(np.float32)
    return after if np.isfinite(after).all() else None


def refuse_map_coordinates(points: np.ndarray, what: str = "points") -> None:
    """Raise InputError if finite points (N, 3) [m], N >= 1, have a coordinate beyond COORDINATE_LIMIT."""
    largest = np.abs(points).max()
    if largest > COORDINATE_LIMIT:
        far = int((np.abs(points) > COORDINATE_LIMIT).any(axis=1).sum())
        raise InputError(
            f"{far:,} of {len(points):,} {what} lie beyond {COORDINATE_LIMIT / 1000:g} km (largest coordinate "
            f"{largest:.6g} m): {_looks_like(points)}"
        )


def refuse_other_unit(points: np.ndarray) -> None:
    """Raise InputError if finite points (N, 3), N >= 1, are in degrees, or too far from the sensor for meters."""
    *level, high = np.ptp(points, axis=0)
    wide = max(level)
    if 0 < wide < _MAX_DEGREES:
        median = np.abs(np.median(points[:, :2], axis=0)).max()
        if min(high, median) > _LEAST_RATIO * wide:
            raise InputError(f"these look like degrees, as x and y span {wide:.2g}, and z {high:.3g}: {DEGREES}")
    if np.abs(points).max() <= _MAX_WHOLE:
        return
    far = float(np.median(np.abs(points).max(axis=1)))
    are_whole = far > _MAX_WHOLE and bool((points == np.round(points)).all())
    if far > _MAX_MEDIAN or are_whole:
        which = "its coordinates are whole numbers, and " if are_whole else ""
        raise InputError(f"{which}half of its points lie beyond {far:,.0f} m: {_looks_like(points)}")


def _looks_like(points: np.ndarray) -> str:
    """Words on why finite points (N, 3) are too far from the origin for a scan, and what to do: a scan in another unit
    surrounds its sensor, one in map coordinates is far from the origin."""
    with np.errstate(over="ignore"):
        are_away = np.abs(np.median(points, axis=0)).max() > _AWAY * np.ptp(points, axis=0).max()
    if are_away:
        return (
            "these look like map coordinates (UTM, or a local grid); give scans in meters in the sensor's own frame: "
            "subtract the sensor's position from the points of each scan"
        )
    return "are these millimeters, or another unit? Say which with --units, such as mm"


def _usable_viewpoints(viewpoints: np.ndarray) -> np.ndarray:
    """Viewpoints (N, 3) float32. Raises InputError: one is not finite, or a map coordinate."""
    with np.errstate(invalid="ignore"):
        places = viewpoints.astype(np.float64)
    bad = int((~np.isfinite(places).all(axis=1)).sum())
    if bad:
        raise InputError(f"viewpoints of {bad:,} of {len(places):,} points are NaN or infinite; give all or none")
    refuse_map_coordinates(places, "viewpoints")
    return places.astype(np.float32)


def _usable_strength(strength: np.ndarray) -> tuple[np.ndarray, int]:
    """Strengths (N,) float32 >= 0, and the number of values that were set to 0."""
    with np.errstate(invalid="ignore"):
        linear = strength.astype(np.float64)
    good = (linear >= 0) & (linear <= np.finfo(np.float32).max)
    return np.where(good, linear, 0.0).astype(np.float32), len(linear) - int(good.sum())
