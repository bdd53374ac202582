"""Printed results of `sonarmap map`: a summary on one screen, tables of pairs and control points, ties."""

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from datetime import timedelta
from pathlib import Path
from shlex import quote
from typing import TYPE_CHECKING, Any

import typer

from sonarmap.kernels.counted import counted
from sonarmap.kernels.errors import InputError
from sonarmap.slam.parts import placed, unplaced
from sonarmap.tools.command.failures import as_options
from sonarmap.tools.command.terminal import number_table, print_json, printable, result_console, warn

if TYPE_CHECKING:
    from rich.table import Table

    from sonarmap.slam.graph.control import MeasuredControl
    from sonarmap.slam.pair import Pair
    from sonarmap.slam.survey_result import SurveyResult

MOST_WARNINGS = 3  # --verbose shows all
MOST_OF_A_KIND = 5  # warnings of one kind
MOST_FILES = 12  # names of files on a terminal
_LABELS = 9  # columns of the rows' labels


@dataclass(frozen=True, slots=True)
class Mapped:
    """The result of a run of `map`."""

    result: "SurveyResult"
    names: Sequence[str]  # of the scans
    out: Path
    unread: int  # number of scans that could not be read, which `names` lacks
    on_earth: bool = False  # whether the map's place on the Earth is known
    made_of_it: list[str] = field(default_factory=list[str])  # files written after the map: its report, and exports
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


def print_mapped(mapped: Mapped, seconds: float, verbose: bool) -> None:
    """Print a survey's summary, the warnings about it, the next commands, and the files."""
    if verbose:
        print_pairs(mapped.result, mapped.names)
    _print_rows([*_outcome(mapped), ("time", str(timedelta(seconds=round(seconds))))])
    print_hand(mapped.result, mapped.names)
    warn_of_faults(mapped, verbose)
    _print_rows([("next", _next_steps(mapped)), ("files", f"{printable(str(mapped.out))}: {_files(mapped)}")])


def print_summary(out: Path) -> None:
    """Print a map's summary.json on one line."""
    print_json(json.loads(written_summary(out)))


def written_summary(out: Path) -> str:
    """The text of the summary.json that this run has written."""
    from sonarmap.tools.files.readers.csv_table import SUMMARY

    try:
        return (out / SUMMARY).read_text(encoding="utf-8")
    except OSError as error:
        reason = error.strerror or error
        raise InputError(f"cannot read {out / SUMMARY}: {reason}; it was removed. Run the command again") from error


def warn_of_faults(mapped: Mapped, verbose: bool = False) -> None:
    """Print the warnings about a map, the most important first: all of them, or those that fit a screen."""
    from sonarmap.tools.files.readers.csv_table import SUMMARY
    from sonarmap.tools.products.output.faults import faults

    sentences = [as_options(fault) for fault in faults(mapped.result, mapped.names)]
    shown = sentences if verbose else sentences[:MOST_WARNINGS]
    for fault in shown:
        warn(fault)
    if more := len(sentences) - len(shown):
        warn(f"{more} more: {mapped.out / SUMMARY} (warnings), or --verbose")


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
    between = len(result.trajectory) - len(result.keys) - len(result.odd)
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
        if REPORT in mapped.made_of_it
        else []
    )
    if len(mapped.result.components) == 1:
        place = "" if mapped.on_earth else " --origin LAT,LON"
        steps.append(f"sonarmap export {out} -o gis --format laz,geotiff{place}")
    else:
        steps.append("to join the maps: --priors FILE (navigation), --set hypotheses=24, or more scans in between")
    return "\n".join(steps)


def _files(mapped: Mapped) -> str:
    """Names of the written files; on a terminal the first of them."""
    from sonarmap.tools.files.map_folder.names import JOURNAL, OF_ALL, TIMES
    from sonarmap.tools.products.output.folder import part_files

    parts = len(placed(mapped.result.components))
    names = [*part_files(mapped.result, 1), *mapped.made_of_it, *OF_ALL, TIMES, JOURNAL]
    shown = names[:MOST_FILES] if result_console().is_terminal else names
    listed = ", ".join(shown) + (f" and {len(names) - len(shown)} more" if len(names) > len(shown) else "")
    last = f" to map_{parts}.ply" if parts > 2 else ""
    return listed + (f"; the other parts are in map_2.ply{last} and so on" if parts > 1 else "")


PEAK_EXPLAINED = "peak: how high the correlation stands above its surroundings, in their standard deviations"
SIGMAS_EXPLAINED = "sigmas: how far the pair is from the final poses, in standard deviations"
_NUMBERS = ("peak", "overlap", "yaw", "distance", "sigmas", "seconds")
LISTED = 20  # points in the table; summary.json lists all


def print_pairs(result: "SurveyResult", names: Sequence[str]) -> None:
    """Print the table of pairs, the reasons of the refused ones, and chi-squared before and after optimizing."""
    console = result_console()
    console.print(_table(result.pairs, names))
    refused = [pair for pair in result.pairs if not pair.kept]
    for pair in refused:
        console.print(f"{_label(pair, names)}: {printable(as_options(pair.reason))}", markup=False)
    if any(pair.registration and math.isfinite(pair.registration.psr) for pair in result.pairs):
        typer.echo(PEAK_EXPLAINED)
    typer.echo(SIGMAS_EXPLAINED)
    solution = result.solution
    typer.echo(
        f"chi-squared {solution.chi_squared_before:.4g} before and {solution.chi_squared_after:.4g} after optimizing, "
        f"for {solution.degrees_of_freedom} degrees of freedom"
    )


def _table(pairs: "Sequence[Pair]", names: Sequence[str]) -> "Table":
    from rich.text import Text

    table = number_table("pair", "role", "", *_NUMBERS, words=3)
    table.collapse_padding = table.columns[1].no_wrap = table.columns[2].no_wrap = True
    for pair in pairs:
        verdict = Text("kept", "green") if pair.kept else Text("rejected", "red")
        table.add_row(Text(_label(pair, names)), pair.role, verdict, *_numbers(pair))
    return table


def _label(pair: "Pair", names: Sequence[str]) -> str:
    return printable(f"{names[pair.i]} - {names[pair.j]}").replace("\n", "\\n")


def _numbers(pair: "Pair") -> Sequence[str]:
    """Numbers of a pair, as `_NUMBERS`; "" for a pair that could not be registered."""
    if pair.registration is None:
        return [""] * len(_NUMBERS)
    registration, T = pair.registration, pair.registration.T_target_source
    return [
        f"{registration.psr:.0f}" if math.isfinite(registration.psr) else "",
        f"{registration.overlap:.0%}",
        f"{T.rotation.as_euler('ZYX', degrees=True)[0]:+.1f}°",
        f"{float((T.translation**2).sum() ** 0.5):.2f} m",
        f"{pair.residual:.1f}" if math.isfinite(pair.residual) else "",
        f"{registration.seconds:.2f}",
    ]


def print_hand(result: "SurveyResult", names: Sequence[str]) -> None:
    """Print the effects of ties and the residuals of control points, if there are any."""
    from sonarmap.tools.products.output.pairs_file import control_fit, has_no_effect, tie_effect

    for tie in result.ties:
        if not has_no_effect(result, tie):
            pair = printable(f"{names[tie.i]} - {names[tie.j]}")
            typer.echo(f"tie {pair}: {as_options(tie_effect(result, tie))}")
    if fit := control_fit(result, names):
        _print_control(result, names, fit)


def _print_control(result: "SurveyResult", names: Sequence[str], fit: Mapping[str, Any]) -> None:
    """Print the points with the largest residuals, and the residuals of all by use."""
    table = number_table("point", "scan", "use", "East m", "North m", "Up m", "length m", "sigmas", words=2)
    table.columns[2].justify = "left"
    ranked = sorted(range(len(result.control)), key=lambda k: -result.control[k].in_sigmas)
    worst = sorted(ranked[:LISTED])
    for k in worst:
        table.add_row(*_cells(result.control[k], names))
    typer.echo("residuals of control and check points, the map less the known coordinates:")
    result_console().print(table)
    if len(result.control) > len(worst):
        typer.echo(f"the {len(worst)} worst of {len(result.control)}; summary.json lists all")
    uses = {"control": "control points, which the map is fitted to", "check": "check points, which are only compared"}
    for use, what in uses.items():
        if (row := fit[use])["points"]:
            residuals = f"{row['rms_m']:.3f} m root mean square, {row['largest_m']:.3f} m at most"
            typer.echo(f"{what}: {row['points']}, residuals {residuals}")


def _cells(each: "MeasuredControl", names: Sequence[str]) -> list[str]:
    use = "left out" if each.left_out else each.point.use if each.in_world else f"{each.point.use}, not placed"
    residual = each.residual.tolist()
    numbers = [*(f"{value:+.3f}" for value in residual), f"{math.hypot(*residual):.3f}", f"{each.in_sigmas:.1f}"]
    return [printable(each.point.name), printable(names[each.point.scan]), use, *numbers]
