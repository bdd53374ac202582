"""The content of a point cloud file, and the scan of its usable points."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from kernels.errors import InputError
from spectral.scan import Scan

STRENGTH_NAMES = ("strength", "intensity", "amplitude", "reflectivity", "i")

# Sensors see hundreds of meters; beyond this it is a map coordinate, and float32 loses its centimeters.
COORDINATE_LIMIT = 1e5


@dataclass(frozen=True, slots=True)
class Cloud:
    """One cloud as its file holds it, not yet checked.

    Attributes:
        points: (N, 3), integer or floating [m], x forward, y left, z up; NaN and inf allowed.
        strength: (N,), integer or floating, linear, or None.
        stamp: time [s, UTC], or None where the file carries none.
        notes: what the user should know about this cloud, in words.
    """

    points: np.ndarray
    strength: np.ndarray | None = None
    stamp: float | None = None
    notes: tuple[str, ...] = field(default=())


def column_roles(names: Sequence[str]) -> dict[str, int]:
    """Which columns are x, y, z and, where there is one, strength: {role: index}.

    Upper and lower case are the same, and CloudCompare's prefix `scalar_` is ignored.

    Raises:
        InputError: when a coordinate has no column.
    """
    plain = [name.lower().removeprefix("scalar_") for name in names]
    missing = [axis for axis in "xyz" if axis not in plain]
    if missing:
        raise InputError(
            f"no column {', '.join(missing)} among the columns {', '.join(names) or '(none)'}; "
            "name the coordinates x, y and z"
        )
    roles = {axis: plain.index(axis) for axis in "xyz"}
    strength = next((name for name in STRENGTH_NAMES if name in plain), None)
    return roles if strength is None else roles | {"strength": plain.index(strength)}


def cloud_of_columns(columns: Mapping[str, np.ndarray], notes: Sequence[str] = ()) -> Cloud:
    """The cloud of columns x, y, z and perhaps strength, each (N,), whatever else there is."""
    with np.errstate(invalid="ignore"):  # a signaling NaN is dropped later like any other
        points = np.stack([columns[axis] for axis in "xyz"], axis=1)
    return Cloud(points, columns.get("strength"), notes=tuple(notes))


def scan_of_cloud(cloud: Cloud, name: str, stamp: float) -> tuple[Scan, list[str]]:
    """The usable points of `cloud` as a scan, and notes about what was dropped or corrected.

    Points that are NaN or infinite are dropped; strengths that are negative, NaN or infinite become 0.

    Raises:
        InputError: no point at all, none of them finite, or one further than COORDINATE_LIMIT off.
    """
    notes = list(cloud.notes)
    total = len(cloud.points)
    if total == 0:
        raise InputError("no points in it; give a scan with at least one finite point")
    with np.errstate(invalid="ignore"):
        points = cloud.points.astype(np.float64)
    finite = np.isfinite(points).all(axis=1)
    dropped = total - int(finite.sum())
    if dropped == total:
        raise InputError(f"all of its {total:,} points are NaN or infinite; nothing is left to register")
    if dropped:
        notes.append(f"dropped {dropped:,} of {total:,} points that are NaN or infinite")
        points = points[finite]
    _refuse_map_coordinates(points)
    strength = None
    if cloud.strength is not None:
        strength, corrected = _usable_strength(cloud.strength[finite])
        if corrected:
            notes.append(f"set {corrected:,} of {len(strength):,} strengths that are negative or not finite to 0")
    return Scan(points.astype(np.float32), strength, stamp=stamp, name=name), notes


def _refuse_map_coordinates(points: np.ndarray) -> None:
    far = int((np.abs(points) > COORDINATE_LIMIT).any(axis=1).sum())
    if far:
        raise InputError(
            f"{far:,} of {len(points):,} points lie beyond {COORDINATE_LIMIT / 1000:g} km "
            f"(largest coordinate {np.abs(points).max():.6g} m): these look like map coordinates (UTM and "
            "the like) or another unit; give scans in meters in the sensor's own frame: subtract the sensor's "
            "position from the points of each scan"
        )


def _usable_strength(strength: np.ndarray) -> tuple[np.ndarray, int]:
    """(N,) float32 >= 0, and how many values had to be set to 0."""
    with np.errstate(invalid="ignore"):
        linear = strength.astype(np.float64)
    good = (linear >= 0) & (linear <= np.finfo(np.float32).max)
    return np.where(good, linear, 0.0).astype(np.float32), len(linear) - int(good.sum())
