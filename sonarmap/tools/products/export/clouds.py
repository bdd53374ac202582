"""The points that a file of points gets, and two such files, XYZ and E57.

They are those of the map, or of scans in place, which are never together in memory. pye57 stores coordinates in four
bytes. They count from the sensor's place, or the middle of the map, which is the scan's pose in the file, in eight
bytes: readers add it.
"""

from collections.abc import Generator, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from hashlib import sha256
from itertools import count
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from uuid import NAMESPACE_OID, uuid5

import numpy as np

from sonarmap.kernels.errors import InputError
from sonarmap.spectral.scan import Scan
from sonarmap.tools.files.map_folder.folder import Map, MapPart
from sonarmap.tools.files.time_scales import are_times, gps_of_utc
from sonarmap.tools.files.writers.atomic import atomic_path
from sonarmap.tools.products.export.georeferenced import Georeferenced

_FORMS = {"f": "%.6g", "i": "%d", "u": "%d"}  # of columns, by the kind of their numbers
_AT_A_TIME = 100_000  # lines
_UPRIGHT = np.array([1.0, 0.0, 0.0, 0.0])  # quaternion w, x, y, z


@dataclass(frozen=True, slots=True)
class Portion:
    """Points that are written together: a scan's, or all of the map."""

    name: str  # of the scan, or the map
    points: np.ndarray  # (N, 3) float64 [m], in the file's coordinates
    columns: Mapping[str, np.ndarray]  # {name: (N,)}
    stamps: np.ndarray  # (N,) [s], of the scans
    place: np.ndarray  # (3,) float64 [m], of the sensor, or in the midst of the map, in the file's coordinates


@dataclass(frozen=True, slots=True)
class Cloud:
    """The points of one part of a map."""

    folder: Map  # the map
    part: MapPart  # of it
    earth: Georeferenced | None  # of the same part, for projected coordinates; None for the map's own
    scans: Sequence[Scan] | None = None  # all of the map's, for their points; None for the map's own points
    chosen: tuple[int, ...] | None = None  # which of the scans; None for all

    @property
    def timed(self) -> bool:
        return are_times(self.part.trajectory.stamps)

    @property
    def strongest(self) -> float:
        """The strongest echo; 0 where there are no echo strengths."""
        maps: np.ndarray = self.part.columns.get("intensity", np.zeros(0))
        strengths = [maps] if self.scans is None else [scan.strength for scan in self.scans]
        return max((float(np.max(s, initial=0, where=np.isfinite(s))) for s in strengths if s is not None), default=0.0)

    def placed(self, points: np.ndarray) -> np.ndarray:
        """Points (N, 3) of the map's frame in the file's coordinates."""
        if self.earth is None:
            return points
        return self.earth.projection.project(self.earth.georeference.geodetic(points))

    def portions(self) -> Iterator[Portion]:
        """All points, none of them empty."""
        empty = True
        for name, points, columns, stamps, place in self._whole():
            if len(points):
                empty = False
                yield Portion(name, self.placed(points), columns, stamps, self.placed(place[None])[0])
        if empty:
            raise InputError("the chosen scans have no points; choose others")

    def _whole(self) -> Iterator[tuple[str, np.ndarray, Mapping[str, np.ndarray], np.ndarray, np.ndarray]]:
        part = self.part
        if self.scans is None:
            middle = np.median(part.points, axis=0) if len(part.points) else np.zeros(3)
            yield f"map{part.suffix}", part.points, part.columns, part.point_stamps, middle
            return
        surveys = self.folder.surveys(part)
        with_echo = any(scan.strength is not None for scan in self.scans)
        members = [k for k, scan in enumerate(part.scans) if self.chosen is None or scan in self.chosen]
        for k in members:
            number, T = part.scans[k], part.trajectory.T_world_sensor[k]
            scan = self.scans[number]
            points = T.apply(scan.points.astype(np.float64))
            size = len(points)
            columns: dict[str, np.ndarray] = {
                "scan": np.full(size, number, np.int32),
                "survey": np.full(size, surveys[k], np.int32),
            }
            if with_echo:
                columns["intensity"] = np.full(size, np.nan, np.float32) if scan.strength is None else scan.strength
            stamps = np.full(size, part.trajectory.stamps[k])
            yield self.folder.names[number], points, columns, stamps, T.translation


def write_xyz(path: Path, cloud: Cloud) -> Mapping[str, Any]:
    """Write blanks between columns, whose names stand behind // in the first line, where CloudCompare looks for them.
    Returns what the columns are."""
    count, names = 0, ()
    with atomic_path(path) as temporary, temporary.open("w", newline="", encoding="ascii") as file:
        for portion in cloud.portions():
            if not count:
                names = ("x", "y", "z", "stamp", *portion.columns)
                file.write(f"//{' '.join(names)}\n")
            form = " ".join(
                ["%.4f", "%.4f", "%.4f", "%.6f", *(_FORMS[each.dtype.kind] for each in portion.columns.values())]
            )
            for first in range(0, len(portion.points), _AT_A_TIME):
                rows = _rows(portion, slice(first, first + _AT_A_TIME))
                file.writelines(f"{form % row}\n" for row in rows)
            count += len(portion.points)
    return {"points": count, "columns": names, "stamp": "of the scan [s], UTC since 1970 where the scans have times"}


def _rows(portion: Portion, some: slice) -> "zip[tuple[Any, ...]]":
    """The numbers of some points; + 0.0 takes the sign from zeros."""
    places = np.round(portion.points[some], 4) + 0.0
    columns = (column[some].tolist() for column in (*places.T, portion.stamps, *portion.columns.values()))
    return zip(*columns, strict=True)


def write_e57(path: Path, cloud: Cloud) -> Mapping[str, Any]:
    """Write places, and echo strengths where there are any, portion by portion; the time of a scan is that of its
    beginning, as GPS time. Returns what counts from what."""
    from pye57 import E57
    from pye57 import e57 as library

    total = 0
    seed = sha256(cloud.part.points.tobytes() + repr(cloud.chosen).encode()).hexdigest()
    with atomic_path(path) as temporary, _guids_from(library, seed):
        temporary.unlink()
        with E57(str(temporary), mode="w") as file:
            for portion in cloud.portions():
                _write(file, portion, cloud.timed and cloud.scans is not None)
                total += len(portion.points)
    return {
        "points": total,
        "scans": "one per scan of the sonar, by its name" if cloud.scans is not None else "one, the map",
        "coordinates": "float32 from the pose's translation, which is float64: the sensor's place, or the map's middle",
        "intensity": "linear echo strength; 0 where there is none",
    }


@contextmanager
def _guids_from(module: Any, seed: str) -> Generator[None]:
    """GUIDs that follow from what is written, where pye57 draws them: the same map gives the same bytes."""
    drawn, number = module.uuid, count()
    module.uuid = SimpleNamespace(uuid4=lambda: uuid5(NAMESPACE_OID, f"{seed} {next(number)}"))
    try:
        yield
    finally:
        module.uuid = drawn


def _write(file: Any, portion: Portion, timed: bool) -> None:
    places = portion.points - portion.place
    columns: dict[str, np.ndarray] = {f"cartesian{axis}": column for axis, column in zip("XYZ", places.T, strict=True)}
    if "intensity" in portion.columns:
        columns["intensity"] = np.nan_to_num(portion.columns["intensity"])
    bounds = {f"{axis}Minimum": least for axis, least in zip("xyz", portion.points.min(axis=0).tolist(), strict=True)}
    bounds |= {f"{axis}Maximum": most for axis, most in zip("xyz", portion.points.max(axis=0).tolist(), strict=True)}
    if timed:
        bounds["acquisitionStart_dateTimeValue"] = float(gps_of_utc(portion.stamps[:1])[0])
    header = SimpleNamespace(**bounds)
    file.write_scan_raw(columns, name=portion.name, rotation=_UPRIGHT, translation=portion.place, scan_header=header)
