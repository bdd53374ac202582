"""The content of a point cloud file, and its conversion to a scan of the usable points."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from sonarmap.kernels.errors import InputError
from sonarmap.spectral.scan import PosePrior, Scan
from sonarmap.tools.files.geo import DEFAULT_VERTICAL

STRENGTH_NAMES = ("strength", "intensity", "amplitude", "reflectivity", "i")
VIEWPOINT_NAMES = ("vp_x", "vp_y", "vp_z")  # as in PCL's PointWithViewpoint
TIME_NAMES = ("gps_time", "gpstime", "timestamp", "time", "t")

_LISTED = 300  # characters of names that a message lists

# Sensors see hundreds of meters; larger coordinates are map coordinates, whose centimeters float32 would lose.
COORDINATE_LIMIT = 1e5
_LONGEST_SCAN = 3600.0  # [s]
_AWAY = 5.0  # points are map coordinates if their median is farther from the origin than their extent times this
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
    axes: str = "flu"  # of the points by the file, a name of `readers.scans.FRAMES`
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


def scan_of_cloud(cloud: Cloud, name: str, stamp: float) -> tuple[Scan, list[str]]:
    """The usable points of `cloud` as a scan, and notes about dropped points and corrected strengths: points that are
    NaN or infinite are dropped; strengths that are negative, NaN or infinite become 0."""
    notes = list(cloud.notes)
    total = len(cloud.points)
    if total == 0:
        raise InputError("no points in it; give a scan with at least one finite point")
    with np.errstate(invalid="ignore"):
        points = cloud.points.astype(np.float64)
    finite = np.isfinite(points)
    finite = np.ones(total, bool) if finite.all() else finite.all(axis=1)  # all(axis=1) takes ten times as long
    dropped = total - int(finite.sum())
    if dropped == total:
        raise InputError(f"all of its {total:,} points are NaN or infinite; nothing is left to register")
    if dropped:
        notes.append(f"dropped {dropped:,} of {total:,} points that are NaN or infinite")
        points = points[finite]
    refuse_map_coordinates(points)
    strength = None
    if cloud.strength is not None:
        strength, corrected = _usable_strength(cloud.strength[finite])
        if corrected:
            notes.append(f"set {corrected:,} of {len(strength):,} strengths that are negative or not finite to 0")
    viewpoints = None if cloud.viewpoints is None else _usable_viewpoints(cloud.viewpoints[finite])
    times = _times_after(cloud, np.asarray(finite))
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
            f"{largest:.6g} m): {looks_like(points)}"
        )


def looks_like(points: np.ndarray) -> str:
    """Words on why finite points (N, 3) are too far from the origin for a scan, and what to do: a scan in another unit
    surrounds its sensor, one in map coordinates is far from the origin."""
    with np.errstate(over="ignore"):
        are_away = np.abs(np.median(points, axis=0)).max() > _AWAY * np.ptp(points, axis=0).max()
    if are_away:
        return (
            "these look like map coordinates (UTM, or a local grid); give scans in meters in the sensor's own frame: "
            "subtract the sensor's position from the points of each scan"
        )
    return "are these millimeters, or another unit? Say which, as in --units mm, or `read_scans(path, units='mm')`"


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
