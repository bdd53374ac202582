"""What `sonarmap inspect` says of a log of navigation, in words and as JSON."""

import shlex
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import typer

from sonarmap.kernels.counted import counted
from sonarmap.tools.command.terminal import print_rows, printable
from sonarmap.tools.command.words.clock import clock_json, rate_words, span_words

if TYPE_CHECKING:
    from sonarmap.tools.files.readers.checks import Clock
    from sonarmap.tools.files.readers.navigation.overview import LogOverview

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
        **_times(found.clock),
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


def _times(clock: "Clock | None") -> dict[str, str]:
    if clock is None:
        return {"time": "none: its rows have the names of scans"}
    return {"time": span_words(clock), "rate": rate_words(clock, "rows")}


def next_command(log: str, scans: Sequence[str], options: Sequence[str]) -> str:
    """How to make a map with it."""
    words = ["sonarmap map", *(map(shlex.quote, scans) if scans else ["SCANS"]), "--priors", shlex.quote(log)]
    return " ".join([*words, "--prior-sigmas A,H,D,P", *options, "-o map/"])
