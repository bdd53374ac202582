"""An overview of scans, read one by one: how many there are, of what size, when they were taken."""

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from math import nan
from pathlib import Path

import numpy as np

from sonarmap.kernels.errors import InputError
from sonarmap.slam.survey_grid import grid_of_extents
from sonarmap.spectral.grid import Grid, trimmed_box
from sonarmap.tools.files.geo.georeference import Georeference
from sonarmap.tools.files.readers.checks import Clock, clock_of
from sonarmap.tools.files.readers.corrections import AS_RECORDED, Corrections
from sonarmap.tools.files.readers.file import FORMATS, format_of
from sonarmap.tools.files.readers.instruments import values_of
from sonarmap.tools.files.readers.pings.line_file import LineOverview, line_overview
from sonarmap.tools.files.readers.scans import Progress, ScanEntry, files_of, read_entries, stamps_of
from sonarmap.tools.files.readers.selection import select_files

_MOST_NOTES = 20  # of single scans
Place = tuple[float, float, float]  # latitude, longitude [deg], height [m]


@dataclass(slots=True)
class Overview:
    """What files of scans hold: some numbers of every scan so far, and at the end of all."""

    files: tuple[Path, ...]  # in natural order
    kinds: tuple[str, ...]  # what the files are, in words, each kind once
    edge: int  # voxels along each edge of the grid
    names: list[str] = field(default_factory=list[str])  # of all scans, as a file of priors and `map` call them
    unread: list[str] = field(default_factory=list[str])  # why files or scans could not be read, in words
    counts: list[int] = field(default_factory=list[int])  # points of each scan
    extents: list[np.ndarray] = field(default_factory=list[np.ndarray])  # (3,) along x, y, z, without stray echoes [m]
    farthest: float = 0.0  # distance of the farthest point from its frame's origin [m]
    # with_strength, with_viewpoints: how many scans have echo strengths, and viewpoints
    with_strength: int = 0
    with_viewpoints: int = 0
    # of scans with an IMU in the recording, roll and pitch [deg], starboard down and nose up positive
    attitudes: list[np.ndarray] = field(default_factory=list[np.ndarray])
    speeds: list[float] = field(default_factory=list[float])  # of sound, as recorded [m/s]
    clock: Clock | None = None  # of the scans' stamps; None where not all of them have a time
    notes: list[str] = field(default_factory=list[str])  # what the user should know, in words
    lines: list[LineOverview] = field(default_factory=list[LineOverview])  # of pings, of which scans are patches
    # files of lines that are near enough to each other for a map, with the places of their patches
    sites: list[dict[Path, list[Place]]] = field(default_factory=list[dict[Path, list[Place]]])

    def add(self, entry: ScanEntry) -> None:
        """Count in a scan; nothing of it is kept."""
        scan = entry.scan
        if scan is None:
            self.unread.append(entry.reason)
            return
        low, high = trimmed_box(scan)
        self.names.append(entry.name)
        self.counts.append(len(scan.points))
        self.extents.append(high - low)
        self.farthest = max(self.farthest, float(np.sqrt(np.einsum("ij,ij->i", scan.points, scan.points).max())))
        self.with_strength += scan.strength is not None
        self.with_viewpoints += scan.viewpoints is not None
        self.notes += [f"{entry.name}: {note}" for note in entry.notes]
        if entry.patch is not None:
            self._locate(entry.path, entry.patch.geodetic)
        if scan.prior is not None and scan.prior.knows_attitude:
            self.attitudes.append(values_of(scan.prior.T_world_sensor)[:2])
        if entry.sound_speed is not None:
            self.speeds.append(entry.sound_speed)

    def _locate(self, path: Path, place: Place) -> None:
        """Count in a patch at the first site that it is near to, or at a new one."""
        for site in self.sites:
            latitude, longitude, _ = next(iter(site.values()))[0]
            with suppress(InputError):
                Georeference(latitude, longitude).local(np.array([place]))
                site.setdefault(path, []).append(place)
                return
        self.sites.append({path: [place]})

    @property
    def one_map(self) -> tuple[int, list[Path]]:
        """How many scans one map can be made of, and the files of their lines where that is not all of them."""
        if len(self.sites) < 2:
            return len(self.names), []
        return max((sum(map(len, site.values())), list(site)) for site in self.sites)

    @property
    def size(self) -> int:
        """Of all files [bytes]."""
        return sum(path.stat().st_size for path in self.files)

    @property
    def changed(self) -> float:
        """When the last file was changed [s, UTC]."""
        return self.files[-1].stat().st_mtime

    @property
    def points(self) -> tuple[int, float, int]:
        """Least, median and largest number of points of a scan."""
        return min(self.counts), float(np.median(self.counts)), max(self.counts)

    @property
    def attitude(self) -> list[float]:
        """Median roll and pitch [deg]; NaN without any."""
        return np.median(self.attitudes, axis=0).tolist() if self.attitudes else [nan, nan]

    @property
    def grid(self) -> Grid | None:
        """That `map` would choose; None where all points of each scan are in one place."""
        try:
            return grid_of_extents([float(extent.max()) for extent in self.extents], self.edge)
        except InputError:
            return None


def overview_of(
    paths: Sequence[str | Path],
    corrections: Corrections = AS_RECORDED,
    edge: int = 128,
    progress: Progress | None = None,
) -> Overview:
    """What is in the files, folders and patterns, as `read_survey` takes them; a scan at a time is in memory.

    The grid has so many voxels along each edge; `progress` is called with (files read, files in all, words). Raises
    InputError: a path that does not exist, or not one scan that can be read.
    """
    selection = select_files(paths, FORMATS)
    known = (format_of(each.path) for each in selection.files)
    kinds = tuple(dict.fromkeys(each.kind for each in known if each is not None))
    overview, file_notes = Overview(files_of(selection), kinds, edge), list[str]()
    own, are_clouds, are_scans = list[float | None](), list[bool](), list[bool]()
    of_lines: list[Path] = []
    for entry in read_entries(selection, file_notes, progress, corrections):
        overview.add(entry)
        of_lines += [entry.path] * (entry.patch is not None)
        own.append(entry.stamp)
        are_clouds.append(entry.is_cloud)
        are_scans.append(entry.scan is not None)
    if not overview.names:
        raise InputError(overview.unread[0])
    stamps, stamp_notes = stamps_of(own, are_clouds)
    if all(stamp is not None for stamp, is_cloud in zip(own, are_clouds, strict=True) if is_cloud):
        overview.clock = clock_of(np.array(stamps)[are_scans])
    if (more := len(overview.notes) - _MOST_NOTES) > 0:
        overview.notes[_MOST_NOTES:] = [f"and {more:,} more notes of single scans"]
    overview.notes[:0] = [*file_notes, *stamp_notes]
    if len(overview.sites) > 1:
        overview.notes.append(f"the lines are at {len(overview.sites)} sites, too far apart for one map")
    overview.lines += [line_overview(path) for path in dict.fromkeys(of_lines)]
    return overview
