"""`sonarmap bench`: how fast the kernels and a prepared pair are here."""

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
            "--grid", metavar="N", help="Voxels per edge, a power of 2, 16..512; may be repeated. [128 and 256]"
        ),
    ] = None,
    repeats: Annotated[int, typer.Option("--repeats", metavar="R", help="Timed runs of each kernel.", min=1)] = 15,
    pairs: Annotated[
        int, typer.Option("--pairs", metavar="P", help="Simulated pairs to register; 0 for none.", min=0)
    ] = 20,
    kernels: Annotated[bool, typer.Option("--kernels/--no-kernels", help="Time the kernels.")] = True,
    device: DeviceOption = None,
    seed: SeedOption = 0,
    as_json: JsonOption = False,
) -> None:
    """Time each kernel beside its NumPy or SciPy twin, and the registration of prepared pairs.

    A kernel whose result is not its twin's is marked WRONG, and the exit code is 3.
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
        say(f"not what the twin gives: {names}; these figures mean nothing", "error: ", "bold red")
        raise typer.Exit(UNRELIABLE)
