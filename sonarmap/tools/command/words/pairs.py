"""The pairs of a survey as a table that keeps its numbers at any width, and what became of ties and control points."""

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import typer

from sonarmap.tools.command.arguments import as_options
from sonarmap.tools.command.terminal import number_table, printable, result_console

if TYPE_CHECKING:
    from rich.table import Table

    from sonarmap.slam.graph.control import MeasuredControl
    from sonarmap.slam.pair import Pair
    from sonarmap.slam.survey_result import SurveyResult

PEAK_EXPLAINED = "peak: how high the correlation stands above its surroundings, in their standard deviations"
SIGMAS_EXPLAINED = "sigmas: how far the pair is from the final poses, in standard deviations"
_NUMBERS = ("peak", "overlap", "yaw", "distance", "sigmas", "seconds")
_LESS_IMPORTANT = ("seconds", "distance", "yaw")  # in the order in which a narrow terminal does without them
_LEAST_FOR_NAMES = 20  # columns of a terminal
LISTED = 20  # points in the table; summary.json lists all


def print_pairs(result: "SurveyResult", names: Sequence[str]) -> None:
    """Print every pair, why some were refused, and how well the poses fit."""
    console = result_console()
    console.print(_table(result.pairs, names, console.width))
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


def _table(pairs: "Sequence[Pair]", names: Sequence[str], width: int) -> "Table":
    """The table, without the columns that leave no room for the names."""
    from rich.text import Text

    rows = [_numbers(pair) for pair in pairs]
    wide = {name: max(len(name), *(len(row[name]) for row in rows)) + 1 for name in _NUMBERS}
    shown = list(_NUMBERS)
    for name in _LESS_IMPORTANT:
        if width - len("sequential rejected ") - 1 - sum(wide[name] for name in shown) < _LEAST_FOR_NAMES:
            shown.remove(name)
    table = number_table("pair", "role", "", *shown, words=3)
    table.collapse_padding = table.columns[1].no_wrap = table.columns[2].no_wrap = True
    for pair, row in zip(pairs, rows, strict=True):
        verdict = Text("kept", "green") if pair.kept else Text("rejected", "red")
        table.add_row(Text(_label(pair, names)), pair.role, verdict, *(row[name] for name in shown))
    return table


def _label(pair: "Pair", names: Sequence[str]) -> str:
    return printable(f"{names[pair.i]} - {names[pair.j]}").replace("\n", "\\n")


def _numbers(pair: "Pair") -> dict[str, str]:
    """A pair's row of the table; empty where it could not be registered."""
    if pair.registration is None:
        return dict.fromkeys(_NUMBERS, "")
    registration, T = pair.registration, pair.registration.T_target_source
    return {
        "peak": f"{registration.psr:.0f}" if math.isfinite(registration.psr) else "",
        "overlap": f"{registration.overlap:.0%}",
        "yaw": f"{T.rotation.as_euler('ZYX', degrees=True)[0]:+.1f}°",
        "distance": f"{float((T.translation**2).sum() ** 0.5):.2f} m",
        "sigmas": f"{pair.residual:.1f}" if math.isfinite(pair.residual) else "",
        "seconds": f"{registration.seconds:.2f}",
    }


def print_hand(result: "SurveyResult", names: Sequence[str]) -> None:
    """Print what ties and control points of a survey came to; nothing without any."""
    from sonarmap.tools.products.output.pairs_file import control_fit, has_no_effect, tie_effect

    for tie in result.ties:
        if not has_no_effect(result, tie):
            pair = printable(f"{names[tie.i]} - {names[tie.j]}")
            typer.echo(f"tie {pair}: {as_options(tie_effect(result, tie))}")
    if fit := control_fit(result, names):
        _print_control(result, names, fit)


def _print_control(result: "SurveyResult", names: Sequence[str], fit: Mapping[str, Any]) -> None:
    """The worst points with their residuals, and how well all fit."""
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
