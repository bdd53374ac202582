"""What ties and control points came to, in words and a table."""

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import typer

from sonarmap.tools.command.arguments import as_options
from sonarmap.tools.command.terminal import number_table, printable, result_console

if TYPE_CHECKING:
    from sonarmap.slam.graph.control import MeasuredControl
    from sonarmap.slam.survey_result import SurveyResult

LISTED = 20  # points in the table; summary.json lists all


def print_hand(result: "SurveyResult", names: Sequence[str]) -> None:
    """Print what ties and control points of a survey came to; nothing without any."""
    from sonarmap.tools.products.output.hand import control_fit, has_no_effect, tie_effect

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
