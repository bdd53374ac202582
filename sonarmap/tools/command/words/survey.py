"""The end of `sonarmap map`: what came of the survey on one screen."""

import json
from collections.abc import Sequence
from dataclasses import dataclass, field
from datetime import timedelta
from pathlib import Path
from shlex import quote
from typing import TYPE_CHECKING

from sonarmap.kernels.counted import counted
from sonarmap.kernels.errors import InputError
from sonarmap.slam.parts import placed, unplaced
from sonarmap.tools.command.arguments import as_options
from sonarmap.tools.command.terminal import error_console, print_json, printable, result_console, warn

if TYPE_CHECKING:
    from sonarmap.slam.survey_result import SurveyResult

MOST_WARNINGS, LINES_OF_A_WARNING = 3, 2  # what fits a screen; --verbose shows all in full
MOST_OF_A_KIND = 5  # warnings of as many scans
MOST_FILES = 12  # names of files on a terminal
_LABELS = 9  # columns of the words to the left


@dataclass(frozen=True, slots=True)
class Mapped:
    """What a run of `map` made."""

    result: "SurveyResult"
    names: Sequence[str]  # of the scans
    out: Path
    unread: int  # how many more scans could not be read
    on_earth: bool = False  # whether it is known where the map lies on the Earth
    made_of_it: list[str] = field(default_factory=list[str])  # files written after the map: its report, and exports
    # what came of lines of pings, in words
    of_lines: list[tuple[str, str]] = field(default_factory=list[tuple[str, str]])

    @property
    def whole(self) -> bool:
        """Whether every scan is in one map, by more than the usual motion, no pair ended by an error of the method, and
        instruments fit them."""
        from sonarmap.tools.products.output.faults import contradictions

        defects = any(pair.is_defect for pair in self.result.pairs)
        trusted = not (contradictions(self.result) or self.result.unclear or self.result.unconfirmed)
        return trusted and not self.unread and not defects and len(self.result.components) == 1


def print_mapped(mapped: Mapped, seconds: float, verbose: bool) -> None:
    """Print what came of a survey, what its user should look at, what to do next, and the files."""
    from sonarmap.tools.command.words.pairs import print_hand, print_pairs

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
    """The text of the summary.json that this run has written. Raises InputError: it is no longer there."""
    from sonarmap.tools.files.map_folder.names import SUMMARY

    try:
        return (out / SUMMARY).read_text(encoding="utf-8")
    except OSError as error:
        reason = error.strerror or error
        raise InputError(
            f"cannot read {out / SUMMARY}: {reason}; it was written, and then removed. Run the command again"
        ) from error


def warn_of_faults(mapped: Mapped, verbose: bool = False) -> None:
    """Warn of what the user should look at, the most important first: all, or as much as fits a screen."""
    from sonarmap.tools.files.map_folder.names import SUMMARY
    from sonarmap.tools.products.output.faults import faults

    sentences = [as_options(fault) for fault in faults(mapped.result, mapped.names)]
    shown = sentences if verbose else [_shortened(fault) for fault in sentences[:MOST_WARNINGS]]
    for fault in shown:
        warn(fault)
    if shown != sentences:
        more = f"{len(sentences) - len(shown)} more, and all" if len(shown) < len(sentences) else "all"
        warn(f"{more} in full: {mapped.out / SUMMARY} (warnings), or --verbose")


def warn_of_some(messages: Sequence[str]) -> None:
    """Warn of the first of several things of one kind, and say how many more there are."""
    for message in messages[:MOST_OF_A_KIND]:
        warn(message)
    if more := len(messages[MOST_OF_A_KIND:]):
        warn(f"{more} more like these")


def _shortened(fault: str) -> str:
    """On a terminal what fits two lines; elsewhere all of it."""
    console = error_console()
    room = LINES_OF_A_WARNING * (console.width - 10)  # words are not divided at a line's end
    if not console.is_terminal or len(fault) <= room:
        return fault
    return fault[:room].rsplit(" ", 1)[0] + " …"


def _print_rows(rows: Sequence[tuple[str, str]]) -> None:
    """Words on the left, and what they are about beside them, on as many lines as it takes."""
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
    """Of a dense stream, how its scans were placed."""
    if result.keys is None:
        return []
    left = len(result.interpolated)
    between = len(result.trajectory) - len(result.keys) - len(result.odd)
    told = f", {left} placed by motion alone" if left else ""
    return [
        ("stream", f"{counted(len(result.keys), 'key scan')}; {between - left} between them registered to these{told}")
    ]


def _straightened(result: "SurveyResult") -> list[tuple[str, str]]:
    """Of scans that were taken while the sensor moved, how far their points were moved."""
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
    """How navigation and scans agree."""
    from sonarmap.tools.products.output.faults import INSTRUMENTS

    said = [
        f"{used} of {given} {INSTRUMENTS[kind]} used ({sigmas:.1f} sigmas)"
        for kind, (used, given, sigmas) in result.agreement.items()
    ]
    left_out = [f"no {INSTRUMENTS[kind]} used" for kind in result.contradicted]
    return [("measured", ", ".join([*said, *left_out]))] if said or left_out else []


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
    """The track of the sensor through all maps [m], from scan to scan of the same survey and map."""
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
    """What to type now."""
    from sonarmap.tools.files.map_folder.names import REPORT

    out = quote(printable(str(mapped.out)))
    steps = (
        [f"sonarmap view {out}    (the map in 3D, with its loops and uncertainty)"]
        if REPORT in mapped.made_of_it
        else []
    )
    if len(mapped.result.components) == 1:
        place = "" if mapped.on_earth else " --origin LAT,LON"
        steps.append(f"sonarmap export {out} --to gis --format laz,geotiff{place}")
    else:
        steps.append("to join what is apart: --priors FILE (navigation), --set hypotheses=24, or more scans in between")
    return "\n".join(steps)


def _files(mapped: Mapped) -> str:
    """The names of what was written; on a terminal the first of many."""
    from sonarmap.tools.files.map_folder.names import JOURNAL, OF_ALL, TIMES
    from sonarmap.tools.products.output.folder import part_files

    parts = len(placed(mapped.result.components))
    names = [*part_files(mapped.result, 1), *mapped.made_of_it, *OF_ALL, TIMES, JOURNAL]
    shown = names[:MOST_FILES] if result_console().is_terminal else names
    listed = ", ".join(shown) + (f" and {len(names) - len(shown)} more" if len(names) > len(shown) else "")
    last = f" to map_{parts}.ply" if parts > 2 else ""
    return listed + (f"; the other parts are in map_2.ply{last} and so on" if parts > 1 else "")
