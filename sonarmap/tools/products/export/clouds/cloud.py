# pyright: strict, reportMissingTypeStubs=false, reportUnknownMemberType=false
"""The points that a file of points gets: those of the map, or of scans in place, which are never together in memory."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from sonarmap.kernels.errors import InputError
from sonarmap.spectral.point_store import in_turn
from sonarmap.spectral.scan import Scan
from sonarmap.tools.files.map_folder.folder import Map, MapPart
from sonarmap.tools.files.time_scales import are_times
from sonarmap.tools.products.export.georeferenced import Georeferenced


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
        """Whether stamps are Unix seconds."""
        return are_times(self.part.trajectory.stamps)

    @property
    def strongest(self) -> float:
        """The strongest echo; 0 where there are no echo strengths."""
        maps: np.ndarray = self.part.columns.get("intensity", np.zeros(0))
        strengths = [maps] if self.scans is None else [scan.strength for scan in in_turn(self.scans)]
        return max((float(np.max(s, initial=0, where=np.isfinite(s))) for s in strengths if s is not None), default=0.0)

    def placed(self, points: np.ndarray) -> np.ndarray:
        """Points (N, 3) of the map's frame in the file's coordinates."""
        if self.earth is None:
            return points
        return self.earth.projection.project(self.earth.georeference.geodetic(points))

    def portions(self) -> Iterator[Portion]:
        """All points, none of them empty.

        Raises InputError: there are none."""
        empty = True
        for name, points, columns, stamps, place in self._whole():
            if len(points):
                empty = False
                yield Portion(name, self.placed(points), columns, stamps, self.placed(place[None])[0])
        if empty:
            raise InputError("the chosen scans have no points; choose others")

    def _whole(self) -> Iterator[tuple[str, np.ndarray, Mapping[str, np.ndarray], np.ndarray, np.ndarray]]:
        """Portions in the map's frame."""
        part = self.part
        if self.scans is None:
            middle = np.median(part.points, axis=0) if len(part.points) else np.zeros(3)
            yield f"map{part.suffix}", part.points, part.columns, part.point_stamps, middle
            return
        surveys = self.folder.surveys(part)
        with_echo = any(scan.strength is not None for scan in self.scans)
        members = [k for k, scan in enumerate(part.scans) if self.chosen is None or scan in self.chosen]
        for k in in_turn(members):
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
