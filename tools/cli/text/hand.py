"""What ties and control points came to, in words and warnings."""

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

import typer

from tools.cli.arguments import as_options
from tools.cli.terminal import printable, result_console, say
from tools.output.parts import placed

if TYPE_CHECKING:
    from slam.graph.control import MeasuredControl
    from slam.survey_result import SurveyResult

LISTED = 20  # points in the table; summary.json lists all
FAR = 4.0  # sigmas beyond which a point that holds the map is warned of
_OPEN = {
    "tilt_x": "its tilt about East",
    "tilt_y": "its tilt about North",
    "heading": "which way it points",
    "east": "its East",
    "north": "its North",
    "up": "its height",
}


def show_hand(result: "SurveyResult", names: Sequence[str], silent: bool) -> None:
    """Say what ties and control points came to; nothing without any.

    Args:
        result: the survey.
        names: of its scans.
        silent: whether only what should be looked at is said, on stderr.
    """
    if not silent:
        _print_ties(result, names)
        _print_control(result, names)
    _warn_of_ties(result, names)
    _warn_of_control(result, names)


def _warn(message: str) -> None:
    say(message, "warning: ", "bold yellow")


def _print_ties(result: "SurveyResult", names: Sequence[str]) -> None:
    from tools.output.hand import has_no_effect, tie_effect

    for tie in result.ties:
        if not has_no_effect(result, tie):
            pair = printable(f"{names[tie.i]} - {names[tie.j]}")
            typer.echo(f"tie {pair}: {as_options(tie_effect(result, tie))}")


def _warn_of_ties(result: "SurveyResult", names: Sequence[str]) -> None:
    from tools.output.hand import has_no_effect, is_contradicted, tie_effect

    for tie in result.ties:
        effect, pair = tie_effect(result, tie), f"{names[tie.i]} - {names[tie.j]}"
        if has_no_effect(result, tie):
            _warn(f"tie {pair}: {tie.verdict}: {as_options(effect)}")
        elif is_contradicted(result, tie):
            _warn(f"tie {pair}: {as_options(effect)}; look at both scans, and if it is wrong take it out of --ties")
    if result.displaced:
        listed = ", ".join(f"{names[i]} - {names[j]}" for i, j in result.displaced[:5])
        more = ", ..." if len(result.displaced) > 5 else ""
        _warn(
            f"{len(result.displaced)} pairs that the survey keeps by itself are refused for the ties and control "
            f"points: {listed}{more}"
        )


def _print_control(result: "SurveyResult", names: Sequence[str]) -> None:
    """The worst points with their residuals, and how well all fit."""
    from rich.table import Table

    from tools.output.hand import control_fit

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
    typer.echo("residuals of control and check points, the map less the known coordinates:")
    result_console().print(table)
    if len(result.control) > len(worst):
        typer.echo(f"the {len(worst)} worst of {len(result.control)}; summary.json lists all")
    for use, what in (("control", "control points, which hold the map"), ("check", "check points, which hold nothing")):
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


def _warn_of_control(result: "SurveyResult", names: Sequence[str]) -> None:
    for each in result.control:
        if each.left_out:
            where = f"{each.point.name} in {names[each.point.scan]}"
            _warn(
                f"the control point {where} is {math.hypot(*each.residual.tolist()):.2f} m from where everything else "
                f"puts it ({each.wrong:.1f} standard deviations); it is left out. Check its numbers and its scan"
            )
    held = [each for each in result.control if each.point.holds and not each.left_out]
    for each in (each for each in held if each.in_sigmas > FAR):
        _warn(
            f"the control point {each.point.name} in {names[each.point.scan]} is {each.in_sigmas:.1f} of its standard "
            "deviations from where the map has it, and nothing tells which is wrong: check its numbers, or give more "
            "points"
        )
    if not any(each.point.holds for each in result.control):
        return
    graph, holding = result.solution.graph, {each.point.scan for each in held}
    for rank, c in enumerate(placed(result.components), 1):
        members = result.components[c]
        part = "the map" if len(result.components) == 1 else f"map_{rank}.ply" if rank > 1 else "map.ply"
        if graph.lies_in_world(members):
            continue
        if holding.isdisjoint(members):
            _warn(f"no control point is in a scan of {part}; it is not held to the world by any")
        else:
            from slam.graph.measured_poses import MEASURED

            free = [_OPEN[name] for name, open_ in zip(MEASURED, graph.unmeasured[members[0]], strict=True) if open_]
            _warn(
                f"the control points of {part} leave open {', '.join(free)}; at least three that are not on a line "
                "tell all"
            )
