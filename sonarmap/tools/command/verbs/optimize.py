"""`sonarmap optimize`: optimize a pose graph."""

import math
import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, cast

import typer

from sonarmap.kernels.counted import counted
from sonarmap.kernels.errors import InputError
from sonarmap.tools.command.option import OPTIMIZATION, OUTPUT, REQUIRED, JsonOption, QuietOption
from sonarmap.tools.command.terminal import print_json, print_result, print_rows, progress, warn

if TYPE_CHECKING:
    from sonarmap.slam.optimize.solve import Start

NOT_CONVERGED = 3
STARTS = ("chordal", "given")
_USUAL = 3.0  # standard deviations of chi-squared within which a graph is consistent


def command(
    source: Annotated[Path, typer.Argument(help="Pose graph to optimize.", metavar="IN.g2o")],
    out: Path = OUTPUT.option("OUT.g2o", "The optimized pose graph.", REQUIRED, "-o", "--out"),
    start: str = OPTIMIZATION.choice(
        "Initial poses. chordal: computed from the edges alone; given: the poses in the file.",
        STARTS,
    ),
    robust: bool = OPTIMIZATION.flag("--robust", "Reject wrong edges, and leave them out of OUT.g2o."),
    as_json: JsonOption = False,
    quiet: QuietOption = False,
) -> None:
    """Find the poses that fit the edges of a pose graph best.

    OUT.g2o is IN.g2o with new poses; ids, FIX, comments and edges stay as they are. The exit code is 3 if the optimizer
    did not converge; the file is written all the same.
    """
    import numpy as np

    from sonarmap.slam.optimize.solve import optimize
    from sonarmap.tools.files.readers.g2o import read_g2o, require_connected
    from sonarmap.tools.files.writers.atomic import require_writable
    from sonarmap.tools.files.writers.poses import rewrite_g2o

    if out.resolve() == source.resolve():
        raise InputError(f"{out} is also the input; choose another name for the output")
    start_time = time.perf_counter()
    with progress("optimizing", 3, quiet or as_json) as advance:
        graph = read_g2o(source)
        require_connected(source, graph)
        require_writable(out.parent)
        seconds = {"read": time.perf_counter() - start_time}
        advance("read")
        optimized = optimize(graph, cast("Start", start), robust)
        advance("optimized")
        report: dict[str, Any] = optimized.to_json()
        rejected = set(np.flatnonzero(~optimized.accepted).tolist())
        rewrite_g2o(out, source, optimized.graph.trajectory, rejected)
        advance("written")
    report["seconds"] = seconds | optimized.seconds | {"total": time.perf_counter() - start_time}
    print_json(report) if as_json else _print(report, robust, out)
    if not optimized.converged:
        warn(f"the optimizer did not converge in {optimized.iterations} iterations")
        raise typer.Exit(NOT_CONVERGED)


def _print(report: dict[str, Any], robust: bool, out: Path) -> None:
    """Print the report of --json in words; `robust`: wrong edges were rejected."""
    rejected = [loop for loop in report["loops"] if loop["verdict"] == "rejected"]
    print_result(verdict(report, robust))
    print_rows(_rows(report, rejected if robust else None))
    print_result(f"written to {out}")


def verdict(report: dict[str, Any], robust: bool) -> str:
    """Whether the poses fit the edges, in a sentence."""
    chi_squared, freedom = report["chi_squared_after"], report["degrees_of_freedom"]
    numbers = f"chi-squared is {chi_squared:.4g}, about {freedom} is expected"
    if not report["converged"]:
        return f"Not converged: after {report['iterations']} iterations the poses are the best so far, not the optimum."
    if freedom == 0:
        return "The edges cannot contradict each other: every pose follows from one edge."
    beyond = (chi_squared - freedom) / math.sqrt(2 * freedom)
    if beyond > _USUAL:
        advice = "their sigmas may be too small" if robust else "--robust finds wrong edges and leaves them out"
        return f"The edges contradict each other more than their sigmas allow: {numbers}; {advice}."
    if beyond < -_USUAL:
        return f"The poses fit the edges, better than their sigmas say: {numbers}."
    return f"The poses fit the edges: {numbers}."


def _rows(report: dict[str, Any], rejected: list[dict[str, Any]] | None) -> dict[str, str]:
    loops = sum(loop["kind"] == "loop" for loop in report["loops"])
    left_out = f"{counted(len(rejected), 'edge')}, left out; --json lists them" if rejected else "no edge"
    return {
        "graph": f"{report['poses']:,} poses, {report['edges']:,} edges, {loops:,} of them loops",
        **({} if rejected is None else {"rejected": left_out}),
        "chi-squared": f"{report['chi_squared_before']:.6g} before, {report['chi_squared_after']:.9g} after "
        f"{report['iterations']} iterations from the {report['start']} start; {report['degrees_of_freedom']} degrees "
        "of freedom",
    }
