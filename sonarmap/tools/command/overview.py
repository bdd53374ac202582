"""An overview of scans, read one by one: how many there are, of what size, when they were taken."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from math import nan
from pathlib import Path

import numpy as np

from sonarmap.kernels.errors import InputError
from sonarmap.slam.survey_grid import grid_of_extents
from sonarmap.spectral.grid import Grid, trimmed_box
from sonarmap.tools.files.readers.clock import Clock, clock_of
from sonarmap.tools.files.readers.corrections import AS_RECORDED, Corrections
from sonarmap.tools.files.readers.file import FORMATS
from sonarmap.tools.files.readers.instruments import values_of
from sonarmap.tools.files.readers.scans import Progress, ScanEntry, files_of, read_entries, stamps_of
from sonarmap.tools.files.readers.selection import select_files

_MOST_NOTES = 20  # of single scans


@dataclass(frozen=True, slots=True)
class Overview:
    """What files of scans hold."""

    files: tuple[Path, ...]  # in natural order
    size: int  # of all files [bytes]
    kinds: tuple[str, ...]  # what the files are, in words, each kind once
    changed: float  # when the last file was changed [s, UTC]
    names: tuple[str, ...]  # of all scans, as a file of priors and `map` call them
    unread: tuple[str, ...]  # why files or scans could not be read, in words
    points: tuple[int, float, int]  # least, median and largest number of points of a scan
    extent: np.ndarray  # (3,) median size of a scan along x, y, z, without stray echoes [m]
    farthest: float  # distance of the farthest point from its frame's origin [m]
    clock: Clock | None  # of the scans' stamps; None where not all of them have a time
    # with_strength, with_viewpoints, with_attitude: how many scans have echo strengths, viewpoints, and roll and pitch
    # by an IMU in the recording
    with_strength: int
    with_viewpoints: int
    with_attitude: int
    attitude: tuple[float, float]  # median roll and pitch [deg], starboard down and nose up positive; NaN without any
    sound_speeds: tuple[float, float] | None  # lowest and highest recorded one [m/s], or None
    grid: Grid | None  # that `map` would choose; None where no scan has an extent
    notes: tuple[str, ...]  # what the user should know, in words


@dataclass(slots=True)
class _Seen:
    """Some numbers of every scan so far."""

    names: list[str] = field(default_factory=list)
    unread: list[str] = field(default_factory=list)
    own_stamps: list[float | None] = field(default_factory=list)
    are_clouds: list[bool] = field(default_factory=list)
    are_scans: list[bool] = field(default_factory=list)
    counts: list[int] = field(default_factory=list)
    extents: list[np.ndarray] = field(default_factory=list)
    attitudes: list[np.ndarray] = field(default_factory=list)
    speeds: list[float] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    farthest: float = 0.0
    with_strength: int = 0
    with_viewpoints: int = 0

    def add(self, entry: ScanEntry) -> None:
        scan = entry.scan
        self.own_stamps.append(entry.stamp)
        self.are_clouds.append(entry.is_cloud)
        self.are_scans.append(scan is not None)
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
        if scan.prior is not None and scan.prior.knows_attitude:
            self.attitudes.append(values_of(scan.prior.T_world_sensor)[:2])
        if entry.sound_speed is not None:
            self.speeds.append(entry.sound_speed)


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
    files, seen, file_notes = files_of(selection), _Seen(), list[str]()
    for entry in read_entries(selection, file_notes, progress, corrections):
        seen.add(entry)
    if not seen.names:
        raise InputError(seen.unread[0])
    clock, stamp_notes = _clock(seen)
    more = len(seen.notes) - _MOST_NOTES
    few = seen.notes[:_MOST_NOTES] + ([f"and {more:,} more notes of single scans"] if more > 0 else [])
    roll, pitch = np.median(seen.attitudes, axis=0).tolist() if seen.attitudes else (nan, nan)
    return Overview(
        files=files,
        size=sum(path.stat().st_size for path in files),
        kinds=tuple(dict.fromkeys(FORMATS[path.suffix.lower()].kind for path in files)),
        changed=files[-1].stat().st_mtime,
        names=tuple(seen.names),
        unread=tuple(seen.unread),
        points=(min(seen.counts), float(np.median(seen.counts)), max(seen.counts)),
        extent=np.median(seen.extents, axis=0),
        farthest=seen.farthest,
        clock=clock,
        with_strength=seen.with_strength,
        with_viewpoints=seen.with_viewpoints,
        with_attitude=len(seen.attitudes),
        attitude=(roll, pitch),
        sound_speeds=(min(seen.speeds), max(seen.speeds)) if seen.speeds else None,
        grid=_grid(seen, edge),
        notes=(*file_notes, *stamp_notes, *few),
    )


def _clock(seen: _Seen) -> tuple[Clock | None, list[str]]:
    stamps, notes = stamps_of(seen.own_stamps, seen.are_clouds)
    own = [stamp for stamp, is_cloud in zip(seen.own_stamps, seen.are_clouds, strict=True) if is_cloud]
    return (None if None in own else clock_of(np.array(stamps)[seen.are_scans])), notes


def _grid(seen: _Seen, edge: int) -> Grid | None:
    try:
        return grid_of_extents([float(extent.max()) for extent in seen.extents], edge)
    except InputError:
        return None  # all points of each scan are in one place
