"""`sonarmap bench`: how fast the kernels and the registration of a prepared pair are on this machine."""

import json
import sys
from typing import Annotated

import typer

from tools.cli.options import DeviceOption, JsonOption, SeedOption
from tools.cli.progress import progress
from tools.cli.terminal import say

DEFAULT_EDGES = (128, 256)
UNRELIABLE = 3


def command(
    grid: Annotated[
        list[int] | None,
        typer.Option(
            "--grid",
            metavar="N",
            help="Voxels along each edge of the grid: an even product of 2, 3 and 5, 16..512; may be repeated. "
            "\\[128 and 256]",
        ),
    ] = None,
    repeats: Annotated[
        int, typer.Option("--repeats", metavar="R", help="Number of timed runs of each kernel.", min=1)
    ] = 15,
    pairs: Annotated[
        int, typer.Option("--pairs", metavar="P", help="Number of simulated pairs to register; 0 for none.", min=0)
    ] = 20,
    kernels: Annotated[bool, typer.Option("--kernels/--no-kernels", help="Time the kernels.")] = True,
    device: DeviceOption = None,
    seed: SeedOption = 0,
    as_json: JsonOption = False,
) -> None:
    """Time each kernel and its NumPy or SciPy equivalent, and the registration of prepared pairs.

    A kernel whose result differs from the equivalent's is marked WRONG, and the exit code is 3.
    """
    from rich.console import Console

    from tools.bench.result import as_json as to_json
    from tools.bench.run import run_bench
    from tools.bench.table import describe

    result = run_bench(
        device,
        list(dict.fromkeys(grid or DEFAULT_EDGES)),
        repeats=repeats,
        pairs=pairs,
        kernels=kernels,
        seed=seed,
        follow=lambda label, total: progress(label, total, quiet=as_json),
    )
    if as_json:
        typer.echo(json.dumps(to_json(result), indent=2, allow_nan=False))
    else:
        Console(width=None if sys.stdout.isatty() else 160).print(describe(result))
    if result.wrong:
        names = ", ".join(f"{kernel.name} at {kernel.edge}^3" for kernel in result.wrong)
        say(f"the result differs from NumPy's or SciPy's: {names}; these times mean nothing", "error: ", "bold red")
        raise typer.Exit(UNRELIABLE)
