"""`sonarmap bench`: how fast the kernels and the registration of a prepared pair are on this machine."""

import json
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any

import typer

from sonarmap.kernels.errors import InputError
from sonarmap.tools.command.options.groups import MEASUREMENT, OUTPUT
from sonarmap.tools.command.options.registration import DeviceOption, JsonOption, SeedOption
from sonarmap.tools.command.progress import progress
from sonarmap.tools.command.terminal import printable, say

DEFAULT_EDGES = (64, 128, 256)
UNRELIABLE, SLOWER = 3, 4

FromOption = Annotated[
    Path | None,
    typer.Option(
        "--from",
        metavar="FILE",
        help="Measure nothing; take an earlier run's result.",
        rich_help_panel=OUTPUT,
        hidden=True,
    ),
]
CompareOption = Annotated[
    Path | None,
    typer.Option(
        "--compare",
        metavar="OLD",
        help="Say what differs from an earlier run. Differences within the noise of both do not count.",
        rich_help_panel=OUTPUT,
    ),
]
OutOption = Annotated[
    Path | None,
    typer.Option(
        "-o", "--out", metavar="FILE", help="Also write the result as JSON: one file to send.", rich_help_panel=OUTPUT
    ),
]
PictureOption = Annotated[
    Path | None,
    typer.Option(
        metavar="FILE", help="Draw the kernels and the device's limits, as PNG.", rich_help_panel=OUTPUT, hidden=True
    ),
]
PageOption = Annotated[
    Path | None,
    typer.Option(
        metavar="FILE",
        help="Write the figures into a page at its marks. docs/benchmarks.md is such a page.",
        rich_help_panel=OUTPUT,
        hidden=True,
    ),
]
SurveyOption = Annotated[
    int,
    typer.Option(
        metavar="N",
        help="Also map a simulated survey of N scans. It goes from files to files; 0 is none.",
        min=0,
        rich_help_panel=MEASUREMENT,
    ),
]


def command(
    grid: Annotated[
        list[int] | None,
        typer.Option(
            "--grid",
            metavar="N",
            help="Voxels per edge, 16..512; may be repeated. They are even products of 2, 3 and 5.",
            rich_help_panel=MEASUREMENT,
            show_default="64, 128 and 256",
        ),
    ] = None,
    repeats: Annotated[
        int,
        typer.Option(
            "--repeats", metavar="R", help="Number of timed runs of each kernel.", min=1, rich_help_panel=MEASUREMENT
        ),
    ] = 15,
    pairs: Annotated[
        int,
        typer.Option(
            "--pairs",
            metavar="P",
            help="Simulated pairs to register; 0 is none.",
            min=0,
            rich_help_panel=MEASUREMENT,
        ),
    ] = 20,
    kernels: Annotated[
        bool, typer.Option("--kernels/--no-kernels", help="Time the kernels.", rich_help_panel=MEASUREMENT, hidden=True)
    ] = True,
    survey: SurveyOption = 0,
    device: DeviceOption = None,
    seed: SeedOption = 0,
    out: OutOption = None,
    compare: CompareOption = None,
    picture: PictureOption = None,
    page: PageOption = None,
    from_: FromOption = None,
    as_json: JsonOption = False,
) -> None:
    """Time the kernels and the registration of pairs.

    Each kernel is timed beside its equivalents in NumPy, SciPy, pyfftw and pyvkfft. One whose result differs from the
    equivalent's is marked WRONG, and the exit code is 3. With --compare it is 4 if anything became slower beyond the
    noise.
    """
    from sonarmap.tools.files.writers.atomic import require_writable
    from sonarmap.tools.files.writers.json_text import write_json
    from sonarmap.tools.lab.bench.output.as_json import read_result, results_of

    old = read_result(compare) if compare else None
    for path in (out, picture, page):
        if path is not None:
            require_writable(path.parent)
    if from_ is not None:
        _refuse_measuring(grid, survey, device)
        result, wrong = read_result(from_), []
    else:
        edges = list(dict.fromkeys(grid or DEFAULT_EDGES))
        result, wrong = _measured(edges, repeats, pairs, kernels, survey, device, seed, as_json)
    if out is not None:
        write_json(out, result)
    with results_of(from_):
        _show(result, picture, page)
    if wrong:
        names = ", ".join(wrong)
        say(f"the result differs from NumPy's or SciPy's: {names}; these times mean nothing", "error: ", "bold red")
        raise typer.Exit(UNRELIABLE)
    with results_of(compare):
        slower = old is not None and _compared(old, result)
    if slower:
        raise typer.Exit(SLOWER)


def _refuse_measuring(grid: list[int] | None, survey: int, device: str | None) -> None:
    given = {"--grid": grid, "--survey": survey, "--device": device}
    if without := [name for name, value in given.items() if value]:
        raise InputError(f"--from measures nothing, so {', '.join(without)} has no effect; leave one of them out")


def _measured(
    edges: list[int],
    repeats: int,
    pairs: int,
    kernels: bool,
    survey: int,
    device: str | None,
    seed: int,
    as_json: bool,
) -> tuple[dict[str, Any], list[str]]:
    """The result, printed, as JSON's types; and the kernels that are wrong."""
    from rich.console import Console

    from sonarmap.tools.lab.bench.output.as_json import as_json as to_json
    from sonarmap.tools.lab.bench.output.table import describe
    from sonarmap.tools.lab.bench.run import run_bench

    measured = run_bench(
        device,
        edges,
        repeats=repeats,
        pairs=pairs,
        kernels=kernels,
        survey=survey,
        seed=seed,
        follow=lambda label, total: progress(label, total, quiet=as_json),
        command=_run_here,
    )
    result = to_json(measured)
    if as_json:
        typer.echo(json.dumps(result, indent=2, allow_nan=False))
    else:
        Console(width=None if sys.stdout.isatty() else 180).print(describe(measured))
    return result, [f"{kernel.name} at {kernel.edge}^3" for kernel in measured.wrong]


def _run_here(arguments: Sequence[str]) -> None:
    """Run `sonarmap` with arguments in this process."""
    from sonarmap.tools.command.main import app

    app(arguments, standalone_mode=False)


def _show(result: Mapping[str, Any], picture: Path | None, page: Path | None) -> None:
    """Draw and write what was asked for."""
    from sonarmap.tools.lab.bench.output.page import write_page
    from sonarmap.tools.lab.bench.output.picture import draw_roofline

    if picture is not None:
        draw_roofline(picture, result)
        say(f"drawn: {printable(str(picture))}")
    if page is not None:
        write_page(page, result)
        say(f"written: the figures of {printable(str(page))}")


def _compared(old: Mapping[str, Any], new: Mapping[str, Any]) -> bool:
    """Say what differs; whether anything is worse."""
    from sonarmap.tools.lab.bench.output.compare import MARGIN, compare

    comparison = compare(old, new)
    for note in comparison.notes:
        say(note, "warning: ", "yellow")
    for change in comparison.changes:
        say(str(change), "worse: " if change.worse else "better: ", "bold red" if change.worse else "green")
    count, worse = len(comparison.changes), len(comparison.regressions)
    say(
        f"{comparison.compared} figures compared: {worse} worse, {count - worse} better, the others within the noise "
        f"(quartiles that overlap, or medians within {MARGIN:.0%})"
    )
    return bool(worse)
