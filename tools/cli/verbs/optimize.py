"""`sonarmap optimize`: a pose graph in, the same one optimized out."""

import json
import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, cast

import typer

from kernels.errors import InputError
from tools.cli.options import JsonOption, QuietOption
from tools.cli.progress import progress
from tools.cli.survey_text import warn
from tools.cli.terminal import printable, result_console

if TYPE_CHECKING:
    from slam.optimize.solve import Objective, Start

UNSETTLED = 3
OBJECTIVES, STARTS = ("full", "isotropic"), ("chordal", "given", "incremental")
MOST_REJECTED = 20  # rows that the table lists


def _check_objective(name: str) -> str:
    return _one_of(name, OBJECTIVES)


def _check_start(name: str) -> str:
    return _one_of(name, STARTS)


def _one_of(name: str, choices: tuple[str, ...]) -> str:
    if name in choices:
        return name
    raise typer.BadParameter(f"{name!r}; wanted one of {', '.join(choices)}. Leave it out for {choices[0]}.")


def command(
    source: Annotated[Path, typer.Argument(help="A pose graph.", metavar="IN.g2o")],
    out: Annotated[Path, typer.Option("-o", "--out", help="Where to write it, optimized.", metavar="OUT.g2o")],
    objective: Annotated[
        str,
        typer.Option(
            "--objective",
            metavar="NAME",
            help="full, with the edges' whole information matrices; isotropic, with one weight for an edge's rotation "
            "and one for its translation, whose optimum can be certified.",
            callback=_check_objective,
        ),
    ] = OBJECTIVES[0],
    start: Annotated[
        str,
        typer.Option(
            "--start",
            metavar="NAME",
            help="Where to begin: chordal, at what the edges alone say; given, at the file's poses; incremental, where "
            "iSAM2 has the poses when they come one by one.",
            callback=_check_start,
        ),
    ] = STARTS[0],
    robust: Annotated[
        bool, typer.Option("--robust", help="Look for wrong edges, and leave them out of OUT.g2o.")
    ] = False,
    compare: Annotated[
        bool,
        typer.Option(
            "--compare/--no-compare", help="Find the other objective's solution too, and tell how far away it lies."
        ),
    ] = True,
    as_json: JsonOption = False,
    quiet: QuietOption = False,
) -> None:
    """Find the poses that agree best with the edges of a pose graph.

    OUT.g2o is IN.g2o with other poses; ids, FIX, comments and the edges' numbers stay as they are. The exit code is 3
    where the optimizer did not come to rest; the file is written all the same.
    """
    import numpy as np

    from slam.optimize.solve import distance_to_other, optimize, without_effect
    from tools.readers.poses.g2o import read_g2o, require_connected
    from tools.writers.atomic import require_writable
    from tools.writers.g2o import rewrite_g2o

    if out.resolve() == source.resolve():
        raise InputError(f"{out} is the input too; choose another name for the output")
    begun = time.perf_counter()
    with progress("optimizing", 3 + compare, quiet or as_json) as advance:
        graph = read_g2o(source)
        require_connected(source, graph)
        require_writable(out.parent)
        seconds = {"read": time.perf_counter() - begun}
        advance("read")
        found = optimize(graph, cast("Objective", objective), cast("Start", start), robust)
        advance("optimized")
        told: dict[str, Any] = found.to_json() | {"distance": None}
        if compare:
            since = time.perf_counter()
            told["distance"] = distance_to_other(found)
            seconds["compare"] = time.perf_counter() - since
            advance("compared")
        rewrite_g2o(out, source, found.graph.trajectory, set(np.flatnonzero(~found.accepted).tolist()))
        advance("written")
    told["seconds"] = seconds | found.seconds | {"total": time.perf_counter() - begun}
    typer.echo(json.dumps(told)) if as_json else _print(told, robust, out)
    if nothing := without_effect(found):
        warn(nothing)
    if not found.converged:
        warn(f"the optimizer had not come to rest after {found.iterations} iterations")
        raise typer.Exit(UNSETTLED)


def _print(told: dict[str, Any], robust: bool, out: Path) -> None:
    rejected = [loop for loop in told["loops"] if loop["verdict"] == "rejected"]
    if rejected:
        _print_rejected(rejected)
    loops = sum(loop["kind"] == "loop" for loop in told["loops"])
    typer.echo(f"{told['poses']} poses, {told['edges']} edges, {loops} of them loops")
    if robust:
        typer.echo(f"{len(rejected)} edges rejected and left out")
    typer.echo(
        f"{told['objective']} cost {told['cost_before']:.6g} before, {told['cost_after']:.9g} after "
        f"{told['iterations']} iterations from the {told['start']} start"
    )
    typer.echo(
        f"chi-squared {told['chi_squared_before']:.6g} before, {told['chi_squared_after']:.6g} after; of a good graph "
        f"about {told['degrees_of_freedom']}, its degrees of freedom"
    )
    typer.echo(_judged(told["certificate"]))
    if told["distance"]:
        typer.echo(_apart(told["distance"]))
    typer.echo(f"written to {printable(str(out))}")


def _judged(certificate: dict[str, Any]) -> str:
    gap = f" (gap {certificate['gap']:.2g})" if certificate["gap"] is not None else ""
    return (
        f"no certificate: {certificate['reason']}" if certificate["verdict"] == "none" else certificate["reason"] + gap
    )


def _apart(distance: dict[str, Any]) -> str:
    if "reason" in distance:
        return f"not compared with the {distance['to']} objective: {distance['reason']}"
    return (
        f"the {distance['to']} objective's solution lies {distance['translation_rms_m']:.3g} m and "
        f"{distance['rotation_rms_deg']:.3g} degrees away (root mean square; at most "
        f"{distance['translation_max_m']:.3g} m and {distance['rotation_max_deg']:.3g} degrees)"
    )


def _print_rejected(rejected: list[dict[str, Any]]) -> None:
    from rich.table import Table

    table = Table("rejected edge", "kind", "sigmas", "reason", box=None, pad_edge=False)
    for loop in sorted(rejected, key=lambda one: -one["sigmas"])[:MOST_REJECTED]:
        table.add_row(f"{loop['i']} - {loop['j']}", loop["kind"], f"{loop['sigmas']:.1f}", loop["reason"])
    result_console().print(table)
    if len(rejected) > MOST_REJECTED:
        typer.echo(f"and {len(rejected) - MOST_REJECTED} more; --json lists all")
