"""Overviews of scan files and of navigation logs, printed and as JSON."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from math import isclose, nan
from pathlib import Path
from typing import Any

import numpy as np
import typer

from sonarmap.kernels.counted import counted
from sonarmap.kernels.errors import InputError
from sonarmap.slam.motion.sweep import span_of
from sonarmap.slam.survey_grid import grid_of_extents
from sonarmap.spectral.grid import Grid, trimmed_box
from sonarmap.tools.command.terminal import print_rows
from sonarmap.tools.files.readers.file import FORMATS, format_of
from sonarmap.tools.files.readers.instruments import values_of
from sonarmap.tools.files.readers.navigation.overview import LogOverview
from sonarmap.tools.files.readers.pings.line_file import LineOverview, line_overview
from sonarmap.tools.files.readers.scans import (
    AS_RECORDED,
    Corrections,
    Progress,
    ScanEntry,
    files_of,
    notes_about,
    read_entries,
    stamps_of,
)
from sonarmap.tools.files.readers.selection import select_files
from sonarmap.tools.files.time_scales import Clock, clock_of, utc
from sonarmap.tools.products.output.trial import Evidence, ScansOnTrial, on_trial

_MOST_NOTES = 20  # about single scans
_MOST_LINES = 6  # of pings, that are printed


@dataclass(slots=True)
class Overview:
    """Statistics of scan files, collected from one scan at a time."""

    files: tuple[Path, ...]  # in natural order
    kinds: tuple[str, ...]  # what the files are, in words, each kind once
    edge: int  # voxels along each edge of the grid
    names: list[str] = field(default_factory=list[str])  # of all scans, as in priors and in `map`
    stamps: list[float] = field(default_factory=list[float])  # of the scans [s]; 0, 1, 2, ... if some have no time
    unread: list[str] = field(default_factory=list[str])  # why files or scans could not be read, in words
    counts: list[int] = field(default_factory=list[int])  # points of each scan
    extents: list[np.ndarray] = field(default_factory=list[np.ndarray])  # (3,) along x, y, z, without stray echoes [m]
    farthest: float = 0.0  # distance of the farthest point from its frame's origin [m]
    # with_strength, with_viewpoints: numbers of scans with echo strengths and with viewpoints
    with_strength: int = 0
    with_viewpoints: int = 0
    # roll and pitch [deg] of scans whose recording has an IMU; starboard down and nose up are positive
    attitudes: list[np.ndarray] = field(default_factory=list[np.ndarray])
    speeds: list[float] = field(default_factory=list[float])  # of sound, as recorded [m/s]
    clock: Clock | None = None  # of the scans' stamps; None if some scans have no time
    notes: list[str] = field(default_factory=list[str])  # what the user should know, in words
    lines: list[LineOverview] = field(default_factory=list[LineOverview])  # lines of pings, whose patches are the scans
    trial: ScansOnTrial = field(default_factory=ScansOnTrial)  # what is wrong with the sonar
    about: list[ScanEntry] = field(default_factory=list[ScanEntry])  # the entries, without their scans

    def add(self, entry: ScanEntry) -> None:
        """Add a scan to the statistics; the scan itself is not kept."""
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
        self.about.append(replace(entry, scan=None))
        if entry.question and entry.question not in self.notes:
            self.notes.append(entry.question)
        if entry.patch is None:
            self.trial.add(scan, entry.stamp, entry.path.parent, span_of(scan))
        if scan.prior is not None and scan.prior.knows_attitude:
            self.attitudes.append(values_of(scan.prior.T_world_sensor)[:2])
        if entry.sound_speed is not None:
            self.speeds.append(entry.sound_speed)

    @property
    def size(self) -> int:
        """Size of all files [bytes]."""
        return sum(path.stat().st_size for path in self.files)

    @property
    def changed(self) -> float:
        """Time at which the last file was changed [s, UTC]."""
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
        """The grid that `map` would choose; None if no scan has an extent."""
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
    """Overview of the scans in files, folders and patterns, as for `read_survey`; one scan at a time is in memory.

    edge: voxels along each edge of the grid. progress is called with (files read, files in all, words). Raises
    InputError: a path does not exist, or no scan can be read.
    """
    selection = select_files(paths, FORMATS)
    formats = (format_of(each.path) for each in selection.files)
    kinds = tuple(dict.fromkeys(each.kind for each in formats if each is not None))
    overview, file_notes = Overview(files_of(selection), kinds, edge), list[str]()
    times, are_clouds, are_scans = list[float | None](), list[bool](), list[bool]()
    of_lines = list[Path]()
    for entry in read_entries(selection, file_notes, progress, corrections):
        overview.add(entry)
        of_lines += [entry.path] * (entry.patch is not None)
        times.append(entry.stamp)
        are_clouds.append(entry.is_cloud)
        are_scans.append(entry.scan is not None)
    if not overview.names:
        raise InputError(overview.unread[0])
    stamps, stamp_notes = stamps_of(times, are_clouds)
    overview.stamps += np.array(stamps)[are_scans].tolist()
    if all(time is not None for time, is_cloud in zip(times, are_clouds, strict=True) if is_cloud):
        overview.clock = clock_of(np.array(overview.stamps))
    notes = notes_about(overview.about)
    if (more := len(notes) - _MOST_NOTES) > 0:
        notes[_MOST_NOTES:] = [f"and {more:,} more notes of single scans"]
    overview.notes += [*file_notes, *stamp_notes, *notes]
    found = [each.words for each in on_trial(Evidence(overview.trial, len(overview.unread)))]
    overview.notes += [words for words in found if not any(note.endswith(words) for note in overview.notes)]
    overview.lines += [line_overview(path, corrections.lines) for path in dict.fromkeys(of_lines)]
    return overview


def overview_json(overview: Overview) -> dict[str, Any]:
    """The overview as JSON; null for unknown values."""
    clock, grid = overview.clock, overview.grid
    return {
        "files": overview.files,
        "bytes": overview.size,
        "kinds": overview.kinds,
        "scans": len(overview.names),
        "first": overview.names[0],
        "last": overview.names[-1],
        "points": dict(zip(("least", "median", "most"), overview.points, strict=True)),
        "extent_m": np.median(overview.extents, axis=0),
        "farthest_m": overview.farthest,
        "clock": clock and _clock_json(clock),
        "sweep_s": overview.trial.sweep.seconds or None,
        "changed": overview.changed,
        "strengths": overview.with_strength,
        "viewpoints": overview.with_viewpoints,
        "sound_speed_mps": (min(overview.speeds), max(overview.speeds)) if overview.speeds else None,
        "attitudes": len(overview.attitudes),
        "roll_pitch_deg": overview.attitude if overview.attitudes else None,
        "lines": overview.lines,
        "grid": grid and {"edge": grid.edge, "voxel": grid.voxel},
        "notes": overview.notes,
        "unread": overview.unread,
    }


def print_overview(overview: Overview) -> None:
    scans, (least, median, most) = len(overview.names), overview.points
    x, y, z = np.median(overview.extents, axis=0)
    files = overview.files[0].name if len(overview.files) == 1 else f"{len(overview.files):,} files"
    span = overview.names[0] if scans == 1 else f"{overview.names[0]} to {overview.names[-1]}"
    grid = overview.grid
    rows = {
        "files": f"{files}, {overview.size / 1e6:,.1f} MB: {', '.join(overview.kinds)}",
        "scans": f"{scans:,}: {span}",
        "points": f"{median:,.0f} per scan in the median, {least:,} to {most:,}",
        "extent": f"{x:.3g} x {y:.3g} x {z:.3g} m in the median; the farthest point is at {overview.farthest:.3g} m",
        **_times(overview),
        "sweep": _sweep(overview),
        **_lines(overview),
        "strengths": _share(overview.with_strength, scans),
        "sound speed": _sound_speed(overview),
        "attitude": _attitude(overview),
        "viewpoints": _share(overview.with_viewpoints, scans),
        "grid": f"--grid {grid.edge} --voxel {grid.voxel:.3g}, as map chooses them" if grid else "scans without extent",
    }
    unread = counted(len(overview.unread), "file or scan", "files or scans")
    unread = f"{counted(scans, 'scan')} can be read, {unread} cannot."
    typer.echo(unread if overview.unread else f"All {scans:,} scans can be read." if scans > 1 else "1 scan.")
    print_rows(rows)


def _times(overview: Overview) -> dict[str, str]:
    clock = overview.clock
    if clock is None:
        return {"time": "not recorded: the scans are numbered"}
    changed = f"; the last file was changed at {utc(overview.changed)} UTC" if clock.is_set else ""
    time = f"{_span_words(clock)}{changed}"
    return {"time": time} if clock.steps == 0 else {"time": time, "rate": _rate_words(clock, "scans")}


def _sweep(overview: Overview) -> str:
    if not overview.trial.sweep.seconds:
        return "not recorded: all points of a scan are of one time"
    return f"{overview.trial.sweep.seconds:.3g} s from the first point of a scan to its last"


def _lines(overview: Overview) -> dict[str, str]:
    """A row about each of the first lines of pings."""
    rows: dict[str, str] = {}
    for number, line in enumerate(overview.lines[:_MOST_LINES], 1):
        roll, pitch, heading = (f"{mean:.1f} ± {swing:.1f}" for mean, swing in (line.roll, line.pitch, line.heading))
        rejected = f", {100 * line.rejected / max(line.beams, 1):.1f} % rejected"
        by = f" by {line.echo_sounder}" if line.echo_sounder else ""
        rows[f"line {number}"] = (
            f"{line.file}: {line.pings:,} pings, {line.beams:,} soundings{by}{rejected}; {line.length:,.1f} m in "
            f"{line.seconds:,.0f} s ({line.speed:.1f} m/s); depth {line.depth[0]:,.1f} to {line.depth[2]:,.1f} m, "
            f"swath {line.swath:,.1f} m; roll {roll}, pitch {pitch}, heading {heading} degrees"
        )
    if (more := len(overview.lines) - _MOST_LINES) > 0:
        rows["more"] = f"{more} more lines; --json has all"
    return rows


def _share(count: int, scans: int) -> str:
    return "none" if count == 0 else "all scans" if count == scans else f"{count:,} of {scans:,} scans"


def _sound_speed(overview: Overview) -> str:
    if not overview.speeds:
        return "not recorded"
    low, high = min(overview.speeds), max(overview.speeds)
    return f"{low:.1f} m/s" if isclose(low, high) else f"changes, {low:.1f} to {high:.1f} m/s"


def _attitude(overview: Overview) -> str:
    if not overview.attitudes:
        return "not recorded"
    (roll, pitch), share = overview.attitude, _share(len(overview.attitudes), len(overview.names))
    return (
        f"{share}, by the recording's own IMU: in the median roll {roll:+.1f}, "
        f"pitch {pitch:+.1f} degrees (starboard down, nose up)"
    )


def _clock_json(clock: Clock) -> dict[str, Any]:
    return {
        "start": clock.start,
        "end": clock.end,
        "start_utc": utc(clock.start),
        "end_utc": utc(clock.end),
        "rate_hz": clock.rate,
        "gaps": clock.gaps,
        "longest_step_s": clock.longest,
        "not_ascending": clock.backward,
        "stands_still": clock.stands_still,
    }


def _span_words(clock: Clock) -> str:
    """Start, end and duration."""
    lasts = f"{clock.end - clock.start:,.1f} s"
    if clock.is_set:
        return f"{utc(clock.start)} to {utc(clock.end)} UTC, {lasts}"
    return f"{clock.start:.10g} to {clock.end:.10g} s, {lasts}; not UTC"


def _rate_words(clock: Clock, what: str) -> str:
    """Rate and gaps of the stamps; `what` names their owners, as "scans"."""
    if clock.rate is None:
        return "not known: the stamps stand still, or do not ascend"
    gaps = "no gaps" if not clock.gaps else f"gaps: {clock.gaps:,}, the longest {clock.longest:.3g} s"
    back = f"; {clock.backward:,} stamps are not later than the one before" if clock.backward else ""
    return f"{clock.rate:.3g} {what} per second, {gaps}{back}"


_UNITS = {"deg": "degrees", "m": "m"}
_LISTED = 10  # lines of a log; --json has all


def log_json(found: LogOverview) -> dict[str, Any]:
    """The overview of a log as JSON; null for unknown values."""
    track, place = found.track, found.log.georeference
    return {
        "log": str(found.path),
        "bytes": found.path.stat().st_size,
        "rows": len(found.log.lines),
        "clock": found.clock and _clock_json(found.clock),
        "columns": {
            name: dict(zip(("rows", "least", "median", "most"), numbers, strict=True))
            for name, numbers in found.ranges.items()
        },
        "origin_deg": place and [place.latitude, place.longitude],
        "track_m": track and track[0],
        "speed_mps": track and {"median": track[1], "most": track[2]},
        "left_out": found.faults,
        "scans": {"count": found.scans, "covered": found.covered, "apart": found.apart} if found.scans else None,
        "notes": list(found.notes),
    }


def print_log(found: LogOverview) -> None:
    """Print the overview of a log."""
    rows = {
        "log": f"{found.path.name}, {found.path.stat().st_size / 1e6:,.1f} MB, {counted(len(found.log.lines), 'row')}",
        **_log_times(found.clock),
    }
    for name, (count, least, median, most) in found.ranges.items():
        what, unit = name.rsplit("_", 1)
        rows[what] = f"{least:.4g} to {most:.4g} {_UNITS[unit]}, {median:.4g} in the median; {counted(count, 'row')}"
    if found.log.georeference is not None:
        place = found.log.georeference
        rows["origin"] = f"{place.latitude:.5f}, {place.longitude:.5f}: x and y count from there"
    if found.track is not None:
        way, median, most = found.track
        rows["track"] = f"{way:,.1f} m, at {median:.2f} m/s in the median, {most:.2f} at most (noise included)"
    if found.scans:
        covered = ", ".join(f"{name.rsplit('_', 1)[0]} {count:,}" for name, count in found.covered.items())
        rows["scans"] = f"of {found.scans:,}: {covered or 'none has a value'}"
    rows["left out"] = counted(len(found.faults), "row") if found.faults else "no row"
    print_rows(rows)
    for fault in found.faults[:_LISTED]:
        typer.echo(f"  line {fault.line}: {fault.kind}: {fault.reason}")
    if len(found.faults) > _LISTED:
        typer.echo(f"  and {len(found.faults) - _LISTED:,} more: --json has all")


def _log_times(clock: Clock | None) -> dict[str, str]:
    if clock is None:
        return {"time": "none: its rows have the names of scans"}
    return {"time": _span_words(clock), "rate": _rate_words(clock, "rows")}
