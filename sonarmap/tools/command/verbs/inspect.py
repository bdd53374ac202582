"""`sonarmap inspect`: what scan files hold, before a map is made of them."""

import math
import shlex
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from sonarmap.kernels.counted import counted
from sonarmap.kernels.errors import InputError
from sonarmap.tools.command.failures import as_options
from sonarmap.tools.command.method import DEFAULT_EDGE, GridOption
from sonarmap.tools.command.navigation import NavigationReading
from sonarmap.tools.command.option import OUTPUT, JsonOption, QuietOption, given, switch, value_option
from sonarmap.tools.command.progress import growing_progress
from sonarmap.tools.command.survey import InputsArgument, PointReading
from sonarmap.tools.command.terminal import print_json, print_rows, printable, say, warn

if TYPE_CHECKING:
    from sonarmap.tools.command.overview import Overview
    from sonarmap.tools.files.readers.checks import Clock
    from sonarmap.tools.files.readers.navigation.overview import LogOverview

INCOMPLETE = 3
_MOST_LINES = 6  # of pings, on a screen


def command(
    inputs: InputsArgument,
    points: PointReading,
    reading: NavigationReading,
    names: Annotated[bool, switch(OUTPUT, "--names", "List all scans' names alone, as priors need them.")] = False,
    grid: GridOption = None,
    plot: Annotated[Path | None, value_option(OUTPUT, "FILE", "Draw a log as PNG.", "--plot")] = None,
    as_json: JsonOption = False,
    quiet: QuietOption = False,
) -> None:
    """Show what scan files hold: how many scans, of what extent, when and how often they were taken, what is lost or
    damaged, and which voxels suit them.

    A scan at a time is in memory. The exit code is 3 if a file or scan cannot be read, 2 if none can.

    If the first INPUT is a log of navigation (CSV, NMEA 0183, TUM), it shows the log's contents and lists rejected
    rows with their line numbers; with scans after it also what it says at their times. The exit code is 3 if no row
    matches a scan.
    """
    from sonarmap.tools.command.overview import overview_of
    from sonarmap.tools.files.readers.navigation.overview import is_log

    if is_log(path := Path(inputs[0])):
        if not _inspect_log(path, inputs[1:], points, reading, plot, as_json, quiet):
            raise typer.Exit(INCOMPLETE)
        return
    for flag, value in (*given(reading).items(), *([("plot", plot)] if plot else [])):
        raise InputError(
            f"--{flag.replace('_', '-')} {value}: it is for a log of navigation; give one as the first INPUT"
        )
    with growing_progress("reading", quiet or as_json) as step:
        overview = overview_of(inputs, points.corrections(), grid or DEFAULT_EDGE, step)
    said = ({} if grid is None else {"grid": grid}) | given(points)
    options = [f"--{name.replace('_', '-')} {_plain(value)}" for name, value in said.items()]
    scans, files = overview.one_map
    quoted = map(shlex.quote, [str(path) for path in files] or inputs)
    following = " ".join(["sonarmap map", *quoted, *options, "-o map/"]) if scans > 1 else None
    if as_json:
        print_json(_as_json(overview, following, names))
    elif names:
        for name in overview.names:
            typer.echo(printable(name))
    else:
        _print(overview, following)
    if not as_json:
        for note in overview.notes:
            say(note)
    for reason in overview.unread:
        warn(f"cannot be read: {as_options(reason)}")
    if overview.unread:
        raise typer.Exit(INCOMPLETE)


def _inspect_log(
    path: Path,
    scans: list[str],
    points: PointReading,
    reading: NavigationReading,
    plot: Path | None,
    as_json: bool,
    quiet: bool,
) -> bool:
    """Show a log; whether it says something of all scans, or there are none."""
    import numpy as np

    from sonarmap.tools.files.readers.navigation.overview import log_overview

    settings = reading.settings(path)
    stamps = np.zeros(0)
    if scans:
        from sonarmap.tools.files.readers.scans import read_survey

        with growing_progress("reading", quiet or as_json) as step:
            stamps = np.array([scan.stamp for scan in read_survey(scans, [], step, points.corrections()).scans])
    found = log_overview(path, settings, stamps)
    options = [f"--{name.replace('_', '-')} {shlex.quote(_plain(value))}" for name, value in given(reading).items()]
    following = next_command(str(path), scans, options)
    if plot is not None:
        from sonarmap.tools.products.report.pictures import draw_log

        draw_log(found, plot)
    if as_json:
        print_json(log_json(found, following))
    else:
        print_log(found, following)
        for note in found.notes:
            say(note)
    if found.apart:
        warn(f"{path}: no row is at the time of a scan, or near it: {found.apart}")
    return not found.apart


def _as_json(overview: "Overview", following: str | None, names: bool) -> dict[str, Any]:
    """All of it as JSON; null for what is not known."""
    import numpy as np

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
        "clock": clock and clock_json(clock),
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
        "next": following,
        **({"names": overview.names} if names else {}),
    }


def _print(overview: "Overview", following: str | None) -> None:
    import numpy as np

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
    typer.echo(f"\nnext: {printable(following)}" if following else "\na map needs at least two scans")


def _times(overview: "Overview") -> dict[str, str]:
    from sonarmap.tools.files.readers.checks import utc

    clock = overview.clock
    if clock is None:
        return {"time": "not recorded: the scans are numbered"}
    changed = f"; the last file was changed at {utc(overview.changed)} UTC" if clock.is_set else ""
    time = f"{span_words(clock)}{changed}"
    return {"time": time} if clock.steps == 0 else {"time": time, "rate": rate_words(clock, "scans")}


def _lines(overview: "Overview") -> dict[str, str]:
    """Of lines of pings, a few rows each of the first."""
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


def _sound_speed(overview: "Overview") -> str:
    if not overview.speeds:
        return "not recorded"
    low, high = min(overview.speeds), max(overview.speeds)
    return f"{low:.1f} m/s" if math.isclose(low, high) else f"changes, {low:.1f} to {high:.1f} m/s"


def _attitude(overview: "Overview") -> str:
    if not overview.attitudes:
        return "not recorded"
    (roll, pitch), share = overview.attitude, _share(len(overview.attitudes), len(overview.names))
    return (
        f"{share}, by the recording's own IMU: in the median roll {roll:+.1f}, "
        f"pitch {pitch:+.1f} degrees (starboard down, nose up)"
    )


def _plain(value: float | str) -> str:
    return value if isinstance(value, str) else f"{value:g}"


def clock_json(clock: "Clock") -> dict[str, Any]:
    """A clock as JSON has it."""
    from sonarmap.tools.files.readers.checks import utc

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


def span_words(clock: "Clock") -> str:
    """From when to when."""
    from sonarmap.tools.files.readers.checks import utc

    lasts = f"{clock.end - clock.start:,.1f} s"
    if clock.is_set:
        return f"{utc(clock.start)} to {utc(clock.end)} UTC, {lasts}"
    return f"{clock.start:.10g} to {clock.end:.10g} s, {lasts}; not UTC"


def rate_words(clock: "Clock", what: str) -> str:
    """How many a second, and where there are none; `what` they are, as "scans"."""
    if clock.rate is None:
        return "not known: the stamps stand still, or do not ascend"
    gaps = "no gaps" if not clock.gaps else f"gaps: {clock.gaps:,}, the longest {clock.longest:.3g} s"
    back = f"; {clock.backward:,} stamps are not later than the one before" if clock.backward else ""
    return f"{clock.rate:.3g} {what} per second, {gaps}{back}"


_UNITS = {"deg": "degrees", "m": "m"}
_LISTED = 10  # lines that are told each; --json has all


def log_json(found: "LogOverview", following: str) -> dict[str, Any]:
    """All that is known of a log; null for what is not."""
    track, place = found.track, found.log.georeference
    return {
        "log": str(found.path),
        "bytes": found.path.stat().st_size,
        "rows": len(found.log.lines),
        "clock": found.clock and clock_json(found.clock),
        "columns": {
            name: dict(zip(("rows", "least", "median", "most"), told, strict=True))
            for name, told in found.ranges.items()
        },
        "origin_deg": place and [place.latitude, place.longitude],
        "track_m": track and track[0],
        "speed_mps": track and {"median": track[1], "most": track[2]},
        "left_out": found.faults,
        "scans": {"count": found.scans, "covered": found.covered, "apart": found.apart} if found.scans else None,
        "notes": list(found.notes),
        "next": following,
    }


def print_log(found: "LogOverview", following: str) -> None:
    """The same on a screen."""
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
        rows["track"] = f"{way:,.1f} m, at {median:.2f} m/s in the median, {most:.2f} at most (noise counts)"
    if found.scans:
        covered = ", ".join(f"{name.rsplit('_', 1)[0]} {count:,}" for name, count in found.covered.items())
        rows["scans"] = f"of {found.scans:,}: {covered or 'it says nothing'}"
    rows["left out"] = counted(len(found.faults), "row") if found.faults else "no row"
    print_rows(rows)
    for fault in found.faults[:_LISTED]:
        typer.echo(f"  line {fault.line}: {fault.kind}: {fault.reason}")
    if len(found.faults) > _LISTED:
        typer.echo(f"  and {len(found.faults) - _LISTED:,} more: --json has all")
    typer.echo(f"\nnext: {printable(following)}")


def _log_times(clock: "Clock | None") -> dict[str, str]:
    if clock is None:
        return {"time": "none: its rows have the names of scans"}
    return {"time": span_words(clock), "rate": rate_words(clock, "rows")}


def next_command(log: str, scans: Sequence[str], options: Sequence[str]) -> str:
    """How to make a map with it."""
    words = ["sonarmap map", *(map(shlex.quote, scans) if scans else ["SCANS"]), "--priors", shlex.quote(log)]
    return " ".join([*words, "--prior-sigmas A,H,D,P", *options, "-o map/"])
