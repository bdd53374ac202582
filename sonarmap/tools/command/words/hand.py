"""What ties and control points came to, in words and a table."""

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

import typer

from sonarmap.tools.command.arguments import as_options
from sonarmap.tools.command.terminal import printable, result_console

if TYPE_CHECKING:
    from sonarmap.slam.graph.control import MeasuredControl
    from sonarmap.slam.survey_result import SurveyResult

LISTED = 20  # points in the table; summary.json lists all


def print_hand(result: "SurveyResult", names: Sequence[str]) -> None:
    """Print what ties and control points came to; nothing without any.

    Args:
        result: the survey.
        names: of its scans.
    """
    _print_ties(result, names)
    _print_control(result, names)


def _print_ties(result: "SurveyResult", names: Sequence[str]) -> None:
    from sonarmap.tools.products.output.hand import has_no_effect, tie_effect

    for tie in result.ties:
        if not has_no_effect(result, tie):
            pair = printable(f"{names[tie.i]} - {names[tie.j]}")
            typer.echo(f"tie {pair}: {as_options(tie_effect(result, tie))}")


def _print_control(result: "SurveyResult", names: Sequence[str]) -> None:
    """The worst points with their residuals, and how well all fit."""
    from rich.table import Table

    from sonarmap.tools.products.output.hand import control_fit

    fit = control_fit(result, names)
    if fit is None:
        return
    table = Table(box=None, pad_edge=False)
    for name in ("point", "scan"):
        table.add_column(name, overflow="fold")
    table.add_column("use", no_wrap=True)
    for name in ("East m", "North m", "Up m", "length m", "sigmas"):
        table.add_column(name, justify="right", no_wrap=True)
    ranked = sorted(range(len(result.control)), key=lambda k: -result.control[k].in_sigmas)
    worst = sorted(ranked[:LISTED])
    for each in (result.control[k] for k in worst):
        table.add_row(*_cells(each, names))
    typer.echo("residuals of control and check points (the map less the known coordinates):")
    result_console().print(table)
    if len(result.control) > len(worst):
        typer.echo(f"the {len(worst)} worst of {len(result.control)}; summary.json lists all")
    uses = {"control": "control points, which the map is fitted to", "check": "check points, which are only compared"}
    for use, what in uses.items():
        if fit[use]["points"]:
            row = fit[use]
            typer.echo(
                f"{what}: {row['points']}, residuals {row['rms_m']:.3f} m root mean square, "
                f"{row['largest_m']:.3f} m at most"
            )


def _cells(each: "MeasuredControl", names: Sequence[str]) -> list[str]:
    use = "left out" if each.left_out else each.point.use if each.in_world else f"{each.point.use}, not placed"
    numbers = [f"{value:+.3f}" for value in each.residual.tolist()]
    length = math.hypot(*each.residual.tolist())
    return [
        printable(each.point.name),
        printable(names[each.point.scan]),
        use,
        *numbers,
        f"{length:.3f}",
        f"{each.in_sigmas:.1f}",
    ]
