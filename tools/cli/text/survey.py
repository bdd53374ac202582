"""The result of a survey as a table, a few sentences, and warnings."""

import math
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from tools.cli.arguments import as_options
from tools.cli.terminal import printable, result_console, say
from tools.output.parts import placed, unplaced

if TYPE_CHECKING:
    from rich.text import Text

    from slam.pair import Pair
    from slam.survey_result import SurveyResult

PEAK_EXPLAINED = "peak: how high the correlation stands above its surroundings, in their standard deviations"
SIGMAS_EXPLAINED = "sigmas: how far the pair is from the final poses, in standard deviations"
UNMOVED = 0.001  # poses moved by less than this were not moved [voxels]
LISTED = 10  # names of scans in a warning; summary.json lists all


def warn(message: str) -> None:
    """Print on stderr what the user should look at."""
    say(message, "warning: ", "bold yellow")


def warn_of_faults(result: "SurveyResult", names: Sequence[str], out: Path) -> None:
    """Warn of stray points, of loops without effect, of every gap with its reason, and of several parts."""
    from slam.graph.edge import components

    stray = sum(point_map.left_out for point_map in result.maps)
    if stray:
        warn(f"{stray:,} points lie too far from the others for the map's voxels and are left out of the map")
    _warn_of_loops_without_effect(result)
    shared, joined = (
        {scan: c for c, members in enumerate(parts) for scan in members}
        for parts in (result.components, components(len(names), result.edges))
    )
    for pair in result.pairs:
        if pair.role == "sequential" and not pair.kept:
            bridged = ", bridged by navigation" if shared[pair.i] == shared[pair.j] else ""
            bridged = ", bridged by other pairs" if joined[pair.i] == joined[pair.j] else bridged
            warn(f"gap between {names[pair.i]} and {names[pair.j]}{bridged}: {as_options(pair.reason)}")
    maps, lone = placed(result.components), unplaced(result.components)
    if len(maps) > 1:
        warn(
            f"no reliable registration joins all the scans: there are {len(maps)} separate parts, each with its own "
            f"map in {out}; the largest is map.ply"
        )
    if lone:
        warn(
            f"{len(lone)} of {len(names)} scans are in no map, as no reliable registration joins them to the others: "
            f"{_listed(lone, names)}"
        )
    for fix in result.wrong_fixes:
        warn(
            f"the {fix.kind} of {names[fix.scan]} is {fix.sigmas:.1f} standard deviations from what everything else "
            "says; it is left out"
        )
    if alone := result.by_navigation:
        warn(
            f"{len(alone)} of {len(names)} scans lie in the map by navigation alone, as no reliable registration joins "
            f"them to the others: {_listed(alone, names)}"
        )


def _listed(scans: Sequence[int], names: Sequence[str]) -> str:
    """The first of their names."""
    return ", ".join(names[k] for k in scans[:LISTED]) + (", ..." if len(scans) > LISTED else "")


def _warn_of_loops_without_effect(result: "SurveyResult") -> None:
    loops = sum(pair.kept and pair.role == "loop" for pair in result.pairs)
    if loops and result.moved < UNMOVED * result.voxel:
        warn(
            f"{loops} loops were kept, but no pose moved by more than {UNMOVED:g} voxels: they add nothing to the "
            "chain of consecutive scans, as when they only join scans that follow each other closely"
        )


def print_survey(result: "SurveyResult", names: Sequence[str], out: Path, also: Sequence[str]) -> None:
    """Print every pair, the sizes of the maps, and the names of the files."""
    from rich.table import Table

    table = Table(box=None, pad_edge=False, collapse_padding=True)
    table.add_column("pair", overflow="fold")
    for name in ("role", ""):
        table.add_column(name, no_wrap=True)
    for name in ("peak", "overlap", "yaw", "distance", "sigmas", "seconds"):
        table.add_column(name, justify="right", no_wrap=True)
    table.add_column("reason", overflow="fold", ratio=1)
    for pair in result.pairs:
        table.add_row(*_cells(pair, names))
    result_console().print(table)
    if any(pair.registration and math.isfinite(pair.registration.psr) for pair in result.pairs):
        typer.echo(PEAK_EXPLAINED)
    typer.echo(SIGMAS_EXPLAINED)
    solution = result.solution
    typer.echo(
        f"chi-squared {solution.chi_squared_before:.4g} before and {solution.chi_squared_after:.4g} after optimizing, "
        f"for {solution.degrees_of_freedom} degrees of freedom"
    )
    counts = sorted((len(result.maps[c].points) for c in placed(result.components)), reverse=True)
    maps = f"{len(counts)} maps" if len(counts) > 1 else "a map"
    points = " and ".join(f"{count:,}" for count in counts)
    kept = sum(pair.kept for pair in result.pairs)
    typer.echo(f"{len(names)} scans, {kept} of {len(result.pairs)} pairs kept, {maps} of {points} points")
    doubted = sum(result.maps[c].doubted for c in placed(result.components))
    if doubted:
        typer.echo(f"{doubted:,} more points, seen by too few scans where others looked, are in map_all.ply alone")
    typer.echo(f"written to {printable(str(out))}: {_files(result, also)}")


def _cells(pair: "Pair", names: Sequence[str]) -> "list[str | Text]":
    """A pair's row of the table."""
    from rich.text import Text

    label = Text(printable(f"{names[pair.i]} - {names[pair.j]}").replace("\n", "\\n"))
    verdict = Text("kept", "green") if pair.kept else Text("rejected", "red")
    if pair.registration is None:
        return [label, pair.role, verdict, "", "", "", "", "", "", printable(as_options(pair.reason))]
    registration = pair.registration
    T = registration.T_target_source
    return [
        label,
        pair.role,
        verdict,
        f"{registration.psr:.0f}" if math.isfinite(registration.psr) else "",
        f"{registration.overlap:.0%}",
        f"{T.rotation.as_euler('ZYX', degrees=True)[0]:+.1f}°",
        f"{float((T.translation**2).sum() ** 0.5):.2f} m",
        f"{pair.residual:.1f}" if math.isfinite(pair.residual) else "",
        f"{registration.seconds:.2f}",
        "" if pair.kept else printable(as_options(pair.reason)),
    ]


def _files(result: "SurveyResult", also: Sequence[str]) -> str:
    """The names of what was written."""
    from tools.output.folder import JOURNAL, OF_ALL, TIMES, part_files

    listed = ", ".join([*part_files(result, 1, also), *OF_ALL, TIMES, JOURNAL])
    parts = len(placed(result.components))
    if parts == 1:
        return listed
    last = f" to map_{parts}.ply" if parts > 2 else ""
    return f"{listed}; the other parts are in map_2.ply{last}, with their pictures and trajectories"
