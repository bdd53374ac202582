"""`sonarmap evaluate`: an estimated trajectory beside the truth."""

import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from tools.cli.options import JsonOption
from tools.cli.terminal import result_console, say

if TYPE_CHECKING:
    from tools.evaluate import Evaluation

ALIGNMENTS = ("positions", "first")


def _check_alignment(alignment: str) -> str:
    if alignment in ALIGNMENTS:
        return alignment
    raise typer.BadParameter(f"{alignment}; wanted one of {', '.join(ALIGNMENTS)}")


def command(
    estimate: Annotated[Path, typer.Argument(help="Estimated trajectory, TUM format.", metavar="ESTIMATE")],
    truth: Annotated[Path, typer.Argument(help="True trajectory, TUM format.", metavar="TRUTH")],
    align: Annotated[
        str,
        typer.Option(
            "--align",
            metavar="HOW",
            help="How the estimate is laid over the truth: by all positions, or by the first pose.",
            callback=_check_alignment,
        ),
    ] = "positions",
    as_json: JsonOption = False,
) -> None:
    """Compare an estimated trajectory with the true one: every pose, the whole (ATE) and each step (RPE).

    Poses belong together where their stamps agree. The alignment is a rigid motion, without scale.
    """
    from tools.evaluate import evaluate
    from tools.readers.tum import read_tum

    result = evaluate(read_tum(estimate), read_tum(truth), "first" if align == "first" else "positions")
    if as_json:
        typer.echo(json.dumps(result.to_json(), allow_nan=False))
    else:
        _print(result)
    if result.unmatched_truths:
        say(f"{result.unmatched_truths} poses of the truth have no estimate", "warning: ", "bold yellow")


def _print(result: "Evaluation") -> None:
    from rich.table import Table

    table = Table("stamp [s]", "position error", "rotation error", box=None)
    for stamp, meters, degrees in zip(result.stamps, result.translation_m, result.rotation_deg, strict=True):
        table.add_row(f"{stamp:.6f}".rstrip("0").rstrip("."), f"{meters:.3f} m", f"{degrees:.2f}°")
    result_console().print(table)
    typer.echo(
        f"{len(result.stamps)} poses, aligned by {'the first pose' if result.alignment == 'first' else 'positions'}"
    )
    typer.echo(f"ATE (root mean square of the position errors): {result.ate_m:.3f} m")
    if len(result.step_translation_m):
        typer.echo(
            f"RPE (worst step): {result.step_translation_m.max():.3f} m, {result.step_rotation_deg.max():.2f} degrees"
        )
