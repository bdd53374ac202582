"""Printed results of `sonarmap map`: a summary on one screen, warnings, ties and control points."""

import json
from collections.abc import Sequence
from dataclasses import dataclass, field
from datetime import timedelta
from pathlib import Path
from shlex import quote
from typing import TYPE_CHECKING

import typer

from sonarmap.kernels.counted import counted
from sonarmap.slam.parts import placed, unplaced
from sonarmap.tools.command.failures import as_options
from sonarmap.tools.command.terminal import print_json, printable, result_console, warn

if TYPE_CHECKING:
    from sonarmap.slam.survey_result import SurveyResult

MOST_WARNINGS = 3  # summary.json has all
MOST_OF_A_KIND = 5  # warnings of one kind
_LABELS = 9  # columns of the rows' labels


@dataclass(frozen=True, slots=True)
class Mapped:
    """The result of a run of `map`."""

    result: "SurveyResult"
    names: Sequence[str]  # of the scans
    out: Path
    unread: int  # number of scans that could not be read, which `names` lacks
    on_earth: bool = False  # whether the map's place on the Earth is known
    # rows of the summary about lines of pings: label and text
    of_lines: list[tuple[str, str]] = field(default_factory=list[tuple[str, str]])

    @property
    def whole(self) -> bool:
        """Whether one map has all scans, no pair failed by an error of the method, no gap is bridged without
        confirmation, and no instrument contradicts the map."""
        from sonarmap.tools.products.output.faults import contradictions

        defects = any(pair.is_defect for pair in self.result.pairs)
        trusted = not (contradictions(self.result) or self.result.unclear or self.result.unconfirmed)
        return trusted and not self.unread and not defects and len(self.result.components) == 1


def print_mapped(mapped: Mapped, seconds: float) -> None:
    """Print a survey's summary, the warnings about it, the next commands, and the folder."""
    _print_rows([*_outcome(mapped), ("time", str(timedelta(seconds=round(seconds))))])
    print_hand(mapped.result, mapped.names)
    warn_of_faults(mapped)
    _print_rows([("next", _next_steps(mapped)), ("files", printable(str(mapped.out)))])


def print_summary(out: Path) -> None:
    """Print a map's summary.json on one line."""
    from sonarmap.tools.files.readers.csv_table import SUMMARY

    print_json(json.loads((out / SUMMARY).read_text(encoding="utf-8")))


def warn_of_faults(mapped: Mapped) -> None:
    """Print the most important warnings about a map, as many as fit a screen."""
    from sonarmap.tools.files.readers.csv_table import SUMMARY
    from sonarmap.tools.products.output.faults import faults

    sentences = [as_options(fault) for fault in faults(mapped.result, mapped.names)]
    for fault in sentences[:MOST_WARNINGS]:
        warn(fault)
    if more := len(sentences[MOST_WARNINGS:]):
        warn(f"{more} more: {mapped.out / SUMMARY} (warnings)")


def warn_of_some(messages: Sequence[str]) -> None:
    """Print the first of several warnings of one kind, and the number of the others."""
    for message in messages[:MOST_OF_A_KIND]:
        warn(message)
    if more := len(messages[MOST_OF_A_KIND:]):
        warn(f"{more} more like these")


def _print_rows(rows: Sequence[tuple[str, str]]) -> None:
    """Print labels on the left and their texts beside them, which may take several lines."""
    from rich.table import Table
    from rich.text import Text

    table = Table.grid(padding=(0, 1))
    table.add_column(no_wrap=True, min_width=_LABELS)
    table.add_column(overflow="fold")
    for label, text in rows:
        table.add_row(Text(label, "bold"), Text(text))
    result_console().print(table)


def _outcome(mapped: Mapped) -> list[tuple[str, str]]:
    result = mapped.result
    parts, outside = placed(result.components), len(unplaced(result.components))
    given = len(mapped.names) + mapped.unread
    lost = [f"{outside} in no map"] * bool(outside) + [f"{mapped.unread} cannot be read"] * bool(mapped.unread)
    where = "one map" if len(parts) == 1 else f"{len(parts)} separate maps"
    where += f" ({', '.join(lost)})" if lost else ""
    points = " and ".join(f"{len(result.maps[c].points):,}" for c in parts)
    doubted = sum(result.maps[c].doubted for c in parts)
    doubtful = f" ({doubted:,} doubtful ones: map_all.ply)" if doubted else ""
    return [
        ("scans", f"{len(mapped.names) - outside} of {given} placed in {where}"),
        *_stream(result),
        *_straightened(result),
        ("loops", _loops(result)),
        *_crossings(result),
        *_agreement(result),
        *mapped.of_lines,
        ("track", f"{way_length(result):,.1f} m"),
        ("map", f"{points} points, voxels of {result.maps[parts[0]].voxel:.3g} m{doubtful}"),
    ]


def _stream(result: "SurveyResult") -> list[tuple[str, str]]:
    """A row about how the scans of a dense stream were placed; none for other surveys."""
    if result.keys is None:
        return []
    alone = len(result.interpolated)
    between = len(result.trajectory) - len(result.keys)
    rest = f", {alone} placed by motion alone" if alone else ""
    return [
        ("stream", f"{counted(len(result.keys), 'key scan')}; {between - alone} between them registered to these{rest}")
    ]


def _straightened(result: "SurveyResult") -> list[tuple[str, str]]:
    """A row about scans corrected for the sensor's motion: how far their points were moved."""
    from statistics import median

    if result.straightened is None:
        return []
    moved = [far for far in result.straightened if far]
    return [
        (
            "bent",
            f"{counted(len(moved), 'scan')} straightened: points moved by {median(moved):.2g} m (95 % of them, median)",
        )
    ]


def _agreement(result: "SurveyResult") -> list[tuple[str, str]]:
    """A row about how navigation and scans agree; none without navigation."""
    from sonarmap.tools.products.output.faults import INSTRUMENTS

    used_kinds = [
        f"{used} of {given} {INSTRUMENTS[kind]} used ({sigmas:.1f} sigmas)"
        for kind, (used, given, sigmas) in result.agreement.items()
    ]
    unused = [f"no {INSTRUMENTS[kind]} used" for kind in result.contradicted]
    return [("measured", ", ".join([*used_kinds, *unused]))] if used_kinds or unused else []


def _loops(result: "SurveyResult") -> str:
    loops = [pair.kept for pair in result.pairs if pair.role == "loop"]
    kept = sum(pair.kept for pair in result.pairs)
    words = f"{sum(loops)} kept, {len(loops) - sum(loops)} refused" if loops else "none tried"
    return f"{words}; {kept} of {counted(len(result.pairs), 'pair')} kept in all"


def _crossings(result: "SurveyResult") -> list[tuple[str, str]]:
    from sonarmap.slam.map.crossing import CrossingError

    error = CrossingError.of(part.crossings for part in result.parts)
    if error.before is None or error.after is None:
        return []
    after, before = error.after.median, error.before.median
    return [("crossings", f"{after:.2g} m between scans, median ({before:.2g} m before the loops)")]


def way_length(result: "SurveyResult") -> float:
    """Length of the sensor's track [m]: distances between consecutive scans of one survey in one map."""
    import numpy as np

    length = 0.0
    for c in placed(result.components):
        members = result.components[c]
        places = result.trajectory.take(members).T_world_sensor.translation
        surveys = np.array([result.surveys[k] for k in members])
        steps = np.linalg.norm(np.diff(places, axis=0), axis=1)
        length += float(steps[surveys[1:] == surveys[:-1]].sum())
    return length


def _next_steps(mapped: Mapped) -> str:
    """The next commands."""
    from sonarmap.tools.files.map_folder.names import REPORT

    out = quote(printable(str(mapped.out)))
    steps = (
        [f"sonarmap view {out}    (the map in 3D, with its loops and uncertainty)"]
        if (mapped.out / REPORT).exists()
        else []
    )
    if len(mapped.result.components) == 1:
        place = "" if mapped.on_earth else " --origin LAT,LON"
        steps.append(f"sonarmap export {out} -o gis --format laz,geotiff{place}")
    else:
        steps.append("to join the maps: --priors FILE (navigation), --set hypotheses=24, or more scans in between")
    return "\n".join(steps)


def print_hand(result: "SurveyResult", names: Sequence[str]) -> None:
    """Print the effects of ties, and how far control points are from the map, if there are any."""
    from sonarmap.tools.products.output.pairs_file import control_fit, has_no_effect, tie_effect

    for tie in result.ties:
        if not has_no_effect(result, tie):
            pair = printable(f"{names[tie.i]} - {names[tie.j]}")
            typer.echo(f"tie {pair}: {as_options(tie_effect(result, tie))}")
    fit = control_fit(result, names) or {}
    uses = {"control": "control points, which the map is fitted to", "check": "check points, which are only compared"}
    for use, what in uses.items():
        if (row := fit.get(use)) and row["points"]:
            residuals = f"{row['rms_m']:.3f} m root mean square, {row['largest_m']:.3f} m at most"
            typer.echo(f"{what}: {row['points']}, residuals {residuals}")
