"""`sonarmap optimize`: optimize a pose graph."""

import json
import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, cast

import typer

from sonarmap.kernels.errors import InputError
from sonarmap.tools.command.arguments import as_options
from sonarmap.tools.command.options.groups import OPTIMIZATION, OUTPUT, completes
from sonarmap.tools.command.options.registration import JsonOption, QuietOption
from sonarmap.tools.command.progress import progress
from sonarmap.tools.command.words.optimization import print_optimized
from sonarmap.tools.command.words.survey import warn

if TYPE_CHECKING:
    from sonarmap.slam.optimize.solve import Objective, Start

NOT_CONVERGED = 3
OBJECTIVES, STARTS = ("full", "isotropic"), ("chordal", "given", "incremental")
MOST_REPAIRED = 10  # edges that the warnings list


def _check_objective(name: str) -> str:
    return _check_choice(name, OBJECTIVES)


def _check_start(name: str) -> str:
    return _check_choice(name, STARTS)


def _check_choice(name: str, choices: tuple[str, ...]) -> str:
    if name in choices:
        return name
    raise typer.BadParameter(f"{name!r}; choose one of {', '.join(choices)}. Leave it out for {choices[0]}.")


ObjectiveOption = Annotated[
    str,
    typer.Option(
        "--objective",
        metavar="NAME",
        help="full or isotropic. full: the whole information matrix of every edge; isotropic: one weight for the "
        "rotation and one for "
        "the translation of an edge, so that the optimum can be certified.",
        callback=_check_objective,
        rich_help_panel=OPTIMIZATION,
        autocompletion=completes(OBJECTIVES),
    ),
]
StartOption = Annotated[
    str,
    typer.Option(
        "--start",
        metavar="NAME",
        help="Initial poses: chordal, given or incremental. chordal: computed from the edges alone; given: the "
        "poses in the file; incremental: "
        "from iSAM2, which adds the poses one by one.",
        callback=_check_start,
        rich_help_panel=OPTIMIZATION,
        autocompletion=completes(STARTS),
    ),
]
RobustOption = Annotated[
    bool,
    typer.Option("--robust", help="Reject wrong edges, and leave them out of OUT.g2o.", rich_help_panel=OPTIMIZATION),
]
RepairOption = Annotated[
    bool,
    typer.Option(
        "--repair",
        help="Make all information matrices positive definite. Says which were not: eigenvalues below a millionth "
        "of the largest are raised to it. OUT.g2o holds the repaired ones.",
        rich_help_panel=OPTIMIZATION,
    ),
]
CompareOption = Annotated[
    bool,
    typer.Option(
        "--compare",
        help="Also solve the other objective. Prints how far its solution is from this one.",
        rich_help_panel=OPTIMIZATION,
    ),
]


def command(
    source: Annotated[Path, typer.Argument(help="Pose graph to optimize.", metavar="IN.g2o")],
    out: Annotated[
        Path, typer.Option("-o", "--out", help="The optimized pose graph.", metavar="OUT.g2o", rich_help_panel=OUTPUT)
    ],
    objective: ObjectiveOption = OBJECTIVES[0],
    start: StartOption = STARTS[0],
    robust: RobustOption = False,
    repair: RepairOption = False,
    compare: CompareOption = False,
    as_json: JsonOption = False,
    quiet: QuietOption = False,
) -> None:
    """Find the poses that fit the edges of a pose graph best.

    OUT.g2o is IN.g2o with new poses; ids, FIX, comments and edges stay as they are. The exit code is 3 if the optimizer
    did not converge; the file is written all the same.
    """
    import numpy as np

    from sonarmap.slam.optimize.solve import distance_to_other, optimize, without_effect
    from sonarmap.tools.files.readers.poses.g2o import Repair, read_g2o, require_connected
    from sonarmap.tools.files.writers.atomic import require_writable
    from sonarmap.tools.files.writers.g2o import rewrite_g2o

    if out.resolve() == source.resolve():
        raise InputError(f"{out} is also the input; choose another name for the output")
    start_time = time.perf_counter()
    with progress("optimizing", 3 + compare, quiet or as_json) as advance:
        repairs: list[Repair] = []
        graph = read_g2o(source, repairs if repair else None)
        require_connected(source, graph)
        require_writable(out.parent)
        seconds = {"read": time.perf_counter() - start_time}
        advance("read")
        optimized = optimize(graph, cast("Objective", objective), cast("Start", start), robust)
        advance("optimized")
        report: dict[str, Any] = optimized.to_json() | {"distance": None}
        if compare:
            compare_time = time.perf_counter()
            report["distance"] = distance_to_other(optimized)
            seconds["compare"] = time.perf_counter() - compare_time
            advance("compared")
        rejected = set(np.flatnonzero(~optimized.accepted).tolist())
        changed = {each.edge: graph.edges[each.edge] for each in repairs}
        rewrite_g2o(out, source, optimized.graph.trajectory, rejected, changed)
        report["repaired"] = [each.words for each in repairs]
        advance("written")
    report["seconds"] = seconds | optimized.seconds | {"total": time.perf_counter() - start_time}
    typer.echo(json.dumps(report)) if as_json else print_optimized(report, robust, out)
    for each in repairs[:MOST_REPAIRED]:
        warn(f"repaired: {each.words}")
    if len(repairs) > MOST_REPAIRED:
        warn(f"{len(repairs)} edges repaired; --json lists all")
    if warning := without_effect(optimized):
        warn(as_options(warning))
    if not optimized.converged:
        warn(f"the optimizer did not converge in {optimized.iterations} iterations")
        raise typer.Exit(NOT_CONVERGED)
