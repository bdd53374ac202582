"""`sonarmap reproduce`: the paper's experiments on simulated scans, beside what the paper reports."""

import json
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from tools.cli.options import DEFAULT_EDGE, DeviceOption, GridOption, JsonOption, QuietOption, SeedOption
from tools.cli.progress import progress
from tools.cli.terminal import printable

if TYPE_CHECKING:
    from tools.reproduce.gaussian import GaussianResult

EXPERIMENTS = ("gaussian",)
DEFAULT_SEEDS, DEFAULT_SIGMA2 = 3, (1.0, 2.0)


def command(
    name: Annotated[str, typer.Argument(help="gaussian: Table 1, Figs. 20 and 21.", metavar="NAME")],
    out: Annotated[Path, typer.Option("-o", "--out", help="Folder for the results.", metavar="OUT")] = Path(
        "reproduction"
    ),
    scene: Annotated[str, typer.Option(help="floodgate, harbor or clutter.", metavar="NAME")] = "floodgate",
    sigma2: Annotated[
        list[float] | None,
        typer.Option(
            metavar="V", help="Variance of the range noise at the largest range \\[m^2]; may be repeated. \\[1 and 2]"
        ),
    ] = None,
    seeds: Annotated[
        int | None, typer.Option(metavar="N", help="How many seeds, counted from --seed. \\[3]", min=1)
    ] = None,
    quick: Annotated[
        bool, typer.Option("--quick", help="Under a minute: one seed and one sigma^2 where none are given.")
    ] = False,
    grid: GridOption = DEFAULT_EDGE,
    device: DeviceOption = None,
    seed: SeedOption = 1,
    as_json: JsonOption = False,
    quiet: QuietOption = False,
) -> None:
    """Repeat an experiment of the paper on simulated scans, and show its numbers beside the paper's.

    OUT gets NAME.csv with every registration, NAME.md with the tables, and NAME.png, a figure like the paper's.
    """
    from kernels.errors import InputError
    from tools.atomic import require_writable
    from tools.reproduce.gaussian import GaussianSettings, run_gaussian
    from tools.reproduce.gaussian_folder import write_gaussian

    if name not in EXPERIMENTS:
        raise InputError(f"no experiment is called {name!r}; there is {', '.join(EXPERIMENTS)}")
    settings = GaussianSettings(
        scene=scene,
        sigma2=tuple(dict.fromkeys(sigma2 or DEFAULT_SIGMA2[: 1 if quick else None])),
        seeds=seeds or (1 if quick else DEFAULT_SEEDS),
        first_seed=seed,
        edge=grid or DEFAULT_EDGE,
    )
    require_writable(out)
    result = run_gaussian(device, settings, lambda label, total: progress(label, total, quiet=quiet or as_json))
    written = write_gaussian(out, result)
    if as_json:
        typer.echo(json.dumps(_as_json(result, written), indent=2, allow_nan=False))
    else:
        _print(result, written)


def _as_json(result: "GaussianResult", written: list[Path]) -> dict[str, object]:
    from dataclasses import asdict

    from tools.reproduce.gaussian_summary import summarize

    return {
        "settings": asdict(result.settings),
        "device": result.device,
        "seconds": result.seconds,
        "summary": [summary.to_json() for summary in summarize(result)],
        "files": [str(path) for path in written],
    }


def _print(result: "GaussianResult", written: list[Path]) -> None:
    from rich.console import Console

    from tools.reproduce.gaussian_page import describe_right, gaussian_tables

    console = Console(width=None if sys.stdout.isatty() else 200, highlight=False)
    for table in gaussian_tables(result):
        console.print(table.rich())
        console.print()
    typer.echo(describe_right(result.settings))
    typer.echo(f"in {', '.join(printable(str(path)) for path in written)}")
