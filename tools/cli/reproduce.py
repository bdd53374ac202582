"""`sonarmap reproduce`: the paper's experiments on simulated scans, beside what the paper reports."""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from tools.cli.options import DeviceOption, JsonOption, QuietOption, check_seed
from tools.cli.progress import progress
from tools.cli.terminal import printable, result_console, say
from tools.reproduce.experiments import ALL, EXPERIMENTS, Request, chosen, create
from tools.simulate.catalog import SCENE_KINDS

if TYPE_CHECKING:
    from tools.reproduce.folder import Record

_SHOWN = "; ".join(f"{name}: {entry.shows}" for name, entry in EXPERIMENTS.items())


SCENES = [name for name, kind in SCENE_KINDS.items() if kind.scale == 1.0]


def _check_scene(scene: str | None) -> str | None:
    """The experiments' steps and noise are of the paper's 256 m: a pool would vanish in them."""
    if scene is None or scene in SCENES:
        return scene
    raise typer.BadParameter(f"{scene}; wanted a scene as large as the paper's, {', '.join(SCENES)}")


SceneOption = Annotated[str | None, typer.Option(help=f"{', '.join(SCENES)}.", metavar="SCENE", callback=_check_scene)]
PageOption = Annotated[
    Path | None,
    typer.Option(
        "--page", metavar="FILE", help="Then write a page on all experiments in OUT, as in docs/reproduction.md."
    ),
]
NoisesOption = Annotated[
    list[float] | None,
    typer.Option(metavar="V", help="Variance of the range noise at the largest range \\[m^2]; may be repeated."),
]
OwnGridOption = Annotated[
    int | None,
    typer.Option(
        "--grid",
        metavar="N",
        help="Voxels per edge, a power of 2, 16..512; the experiment's own if left out.",
    ),
]
FirstSeedOption = Annotated[
    int | None,
    typer.Option("--seed", metavar="S", help="The first of them; same seed, same result.", callback=check_seed),
]


def command(
    name: Annotated[str, typer.Argument(help=f"{_SHOWN}; {ALL}: each in turn.", metavar="NAME")],
    out: Annotated[
        Path, typer.Option("-o", "--out", help="Folder for the results, and to go on from.", metavar="OUT")
    ] = Path("reproduction"),
    quick: Annotated[
        bool, typer.Option("--quick", help="A minute each, with less of everything that no option sets.")
    ] = False,
    fresh: Annotated[bool, typer.Option("--fresh", help="Do again what an earlier run has done.")] = False,
    page: PageOption = None,
    scene: SceneOption = None,
    sigma2: NoisesOption = None,
    seeds: Annotated[int | None, typer.Option(metavar="N", help="How many seeds.", min=1)] = None,
    seed: FirstSeedOption = None,
    grid: OwnGridOption = None,
    device: DeviceOption = None,
    as_json: JsonOption = False,
    quiet: QuietOption = False,
) -> None:
    """Repeat an experiment of the paper on simulated scans, and show its numbers beside the paper's.

    OUT gets NAME.csv with every row, NAME.md with the tables, NAME*.png with figures like the paper's, and the times in
    NAME-seconds.csv, NAME-times.md and NAME.json. A run that was stopped goes on where it was when the same command is
    given again.
    """
    from kernels.device import choose_device
    from spectral.grid import Grid
    from tools.atomic import require_writable
    from tools.reproduce.page import write_page

    if grid is not None:
        Grid(grid, 1.0)
    silent = quiet or as_json
    noises = tuple(dict.fromkeys(sigma2)) if sigma2 else None
    names = chosen(name, Request(None, quick, seeds, seed, grid, scene, noises))
    require_writable(out)
    opened = choose_device(device)
    for note in opened.notes:
        say(note)
    request = Request(opened, quick, seeds, seed, grid, scene, noises)
    records = [_reproduce(one, request, out, fresh, silent, printed=not as_json) for one in names]
    written = write_page(page, out, chosen(ALL, Request())) if page else []
    if as_json:
        typer.echo(json.dumps(_as_json(records, out, written), indent=2, allow_nan=False))
    elif page:
        typer.echo(f"the page is {printable(str(page))}")


def _reproduce(name: str, request: Request, out: Path, fresh: bool, silent: bool, printed: bool) -> "Record":
    """Run one experiment and write its files; what it holds on the device is let go before the next."""
    from tools.reproduce.folder import write_experiment
    from tools.reproduce.provenance import provenance
    from tools.reproduce.run import run

    experiment = create(name, request)
    origin = provenance(experiment, request.opened)
    tell = (lambda _: None) if silent else say
    try:
        result = run(experiment, origin, out, lambda label, total: progress(label, total, quiet=silent), fresh, tell)
    except KeyboardInterrupt:
        tell("the jobs that were done are kept; the same command without --fresh goes on from there")
        raise
    record = write_experiment(out, experiment, result, origin, request.command(name))
    if printed:
        _print(record, out)
    return record


def _print(record: "Record", out: Path) -> None:
    from tools.reproduce.section_text import duration

    console, section = result_console(), record.section
    console.print(section.title, style="bold", markup=False)
    console.print()
    for table in (*section.tables, *section.times):
        console.print(table.rich())
        console.print()
    if section.remarks:
        console.print(section.remarks, markup=False)
        console.print()
    files = ", ".join(printable(str(out / name)) for name in record.files)
    typer.echo(f"{record.jobs} jobs in {duration(record.seconds)}; in {files}")


def _as_json(records: "Sequence[Record]", out: Path, page: Sequence[Path]) -> dict[str, object]:
    from tools.writers.summary import to_json

    return {
        "experiments": [to_json(record) | {"files": [str(out / name) for name in record.files]} for record in records],
        "page": [str(path) for path in page],
    }
