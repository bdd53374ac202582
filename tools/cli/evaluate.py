"""`sonarmap evaluate`: an estimated trajectory beside the truth."""

import json
import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, cast

import typer

from tools.cli.options import JsonOption
from tools.cli.terminal import result_console, say

if TYPE_CHECKING:
    from tools.evaluate import Alignment, Evaluation

EXCEEDED = 3
ALIGNMENTS = {"poses": "all poses", "positions": "all positions", "first": "the first pose"}


def _check_alignment(alignment: str) -> str:
    if alignment in ALIGNMENTS:
        return alignment
    raise typer.BadParameter(f"{alignment}; wanted one of {', '.join(ALIGNMENTS)}")


def _check_limit(limit: float | None) -> float | None:
    if limit is None or limit >= 0:
        return limit
    raise typer.BadParameter(f"{limit}; wanted 0 or more")


def command(
    estimate: Annotated[Path, typer.Argument(help="Estimated trajectory, TUM or KITTI.", metavar="ESTIMATE")],
    truth: Annotated[Path, typer.Argument(help="True trajectory, in the same format.", metavar="TRUTH")],
    align: Annotated[
        str,
        typer.Option(
            "--align",
            metavar="HOW",
            help="How the estimate is laid over the truth: by all poses (positions and orientations), by all "
            "positions, or by the first pose.",
            callback=_check_alignment,
        ),
    ] = "poses",
    max_error_m: Annotated[
        float | None,
        typer.Option(metavar="M", help="Exit code 3 where a position is farther off \\[m].", callback=_check_limit),
    ] = None,
    max_error_deg: Annotated[
        float | None,
        typer.Option(metavar="DEG", help="Exit code 3 where a pose is turned more \\[deg].", callback=_check_limit),
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Compare an estimated trajectory with the true one: every pose, the whole (ATE) and each step (RPE).

    Poses belong together where their stamps agree, or by their line in KITTI files. The alignment is a rigid motion,
    without scale: poses, least squares over positions and orientations, 1 rad weighing as much as 1 m; positions, the
    same without the orientations, for three or more that lie on no line; first, the first pose upon its truth.
    """
    from tools.evaluate import evaluate
    from tools.readers.trajectory import read_pair

    result = evaluate(*read_pair(estimate, truth), cast("Alignment", align))
    if as_json:
        typer.echo(json.dumps(result.to_json(), allow_nan=False))
    else:
        _print(result)
    if result.unmatched_truths:
        say(f"{result.unmatched_truths} poses of the truth have no estimate", "warning: ", "bold yellow")
    if _exceeds(result, max_error_m, max_error_deg):
        raise typer.Exit(EXCEEDED)


def _exceeds(result: "Evaluation", max_error_m: float | None, max_error_deg: float | None) -> bool:
    """Tell the poses whose errors are too large."""
    limits = [math.inf if limit is None else limit for limit in (max_error_m, max_error_deg)]
    beyond = result.beyond(*limits).tolist()
    allowed = [f"{limit:g} {unit}" for limit, unit in zip(limits, ("m", "degrees"), strict=True) if limit < math.inf]
    for k in beyond:
        say(
            f"the pose at {_stamp(float(result.stamps[k]))} s is {result.translation_m[k]:.3f} m and "
            f"{result.rotation_deg[k]:.2f} degrees off; allowed are {' and '.join(allowed)}",
            "error: ",
            "bold red",
        )
    return bool(beyond)


def _stamp(seconds: float) -> str:
    return f"{seconds:.6f}".rstrip("0").rstrip(".")


def _print(result: "Evaluation") -> None:
    from rich.table import Table
    from rich.text import Text

    from tools.evaluate import yaw_deg

    table = Table(box=None, pad_edge=False)
    positions = ("stamp [s]", "estimated x, y, z [m]", "true x, y, z [m]", "off [m]")
    for name in (*positions, "estimated yaw", "true yaw", "turned by"):
        table.add_column(Text(name), justify="right", no_wrap=True)  # brackets are no markup
    estimated_yaw, true_yaw = yaw_deg(result.T_aligned), yaw_deg(result.T_true)
    for k, stamp in enumerate(result.stamps.tolist()):
        table.add_row(
            _stamp(stamp),
            _place(result.T_aligned.translation[k].tolist()),
            _place(result.T_true.translation[k].tolist()),
            f"{result.translation_m[k]:.3f}",
            f"{estimated_yaw[k]:+.2f}°",
            f"{true_yaw[k]:+.2f}°",
            f"{result.rotation_deg[k]:.2f}°",
        )
    result_console().print(table)
    typer.echo(f"{len(result.stamps)} poses, aligned by {ALIGNMENTS[result.alignment]}")
    typer.echo(f"ATE (root mean square of the position errors): {result.ate_m:.3f} m")
    if len(result.step_translation_m):
        typer.echo(
            f"RPE (worst step): {result.step_translation_m.max():.3f} m, {result.step_rotation_deg.max():.2f} degrees"
        )


def _place(meters: list[float]) -> str:
    return " ".join(f"{value:8.2f}" for value in meters)
