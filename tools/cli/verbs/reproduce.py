"""`sonarmap reproduce`: the paper's experiments on simulated scans, evaluations on unseen pairs, whole surveys."""

import json
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from kernels.errors import InputError
from tools.cli.options import DeviceOption, JsonOption, QuietOption, check_seed
from tools.cli.progress import progress
from tools.cli.terminal import printable, result_console, say
from tools.methods.registry import METHODS, find_method
from tools.reproduce.experiments import ALL, EXPERIMENTS, Request, chosen, create, entry_of, group_of, groups, members
from tools.simulate.scenes.catalog import SCENE_KINDS

if TYPE_CHECKING:
    from tools.reproduce.pages.folder import Record
    from tools.reproduce.worker import WorkerProcesses

_NAMES = "; ".join(
    f"'{group}' runs {', '.join(f'{name} ({EXPERIMENTS[name].shows})' for name in members(group))}"
    for group in groups()
)

SCENES = [name for name, kind in SCENE_KINDS.items() if kind.scale == 1.0]


def _check_scene(scene: str | None) -> str | None:
    """Steps and noise of the experiments fit the paper's 256 m and are too large for a small scene."""
    if scene is None or scene in SCENES:
        return scene
    raise typer.BadParameter(f"{scene} is not a scene as large as the paper's; choose {', '.join(SCENES)}")


SceneOption = Annotated[
    str | None, typer.Option(help=f"The scene: {', '.join(SCENES)}.", metavar="SCENE", callback=_check_scene)
]
PageOption = Annotated[
    Path | None,
    typer.Option(
        "--page",
        metavar="FILE",
        help="Also write a page, such as docs/reproduction.md, on all experiments of the group with results in OUT.",
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
        help="Voxels per edge, a power of 2 from 16 to 512. Default: depends on the experiment.",
    ),
]


def _check_methods(names: list[str] | None) -> list[str] | None:
    for name in names or ():
        try:
            find_method(name)
        except InputError as error:
            raise typer.BadParameter(str(error)) from error
    return names


MethodsOption = Annotated[
    list[str] | None,
    typer.Option(
        "--method",
        metavar="NAME",
        help=f"A method to evaluate: {', '.join(METHODS)}; may be repeated. Default: all that the experiment compares.",
        callback=_check_methods,
    ),
]
WorkersOption = Annotated[
    int,
    typer.Option(
        "--workers", metavar="N", min=1, help="Number of processes that share the jobs; the results are the same."
    ),
]
FirstSeedOption = Annotated[
    int | None,
    typer.Option(
        "--seed",
        metavar="S",
        help="The first seed, or the seed of the pairs; the same seed gives the same results.",
        callback=check_seed,
    ),
]


def command(
    name: Annotated[str, typer.Argument(help=f"An experiment, or a group of them: {_NAMES}.", metavar="NAME")],
    out: Annotated[
        Path,
        typer.Option(
            "-o", "--out", help="Folder for the results; a stopped run continues from what is there.", metavar="OUT"
        ),
    ] = Path("reproduction"),
    quick: Annotated[
        bool,
        typer.Option(
            "--quick",
            help="Take at most a minute for each experiment: fewer scenes, seeds, pairs and voxels, unless given.",
        ),
    ] = False,
    fresh: Annotated[
        bool, typer.Option("--fresh", help="Run all jobs again, also those that an earlier run finished.")
    ] = False,
    page: PageOption = None,
    scene: SceneOption = None,
    sigma2: NoisesOption = None,
    seeds: Annotated[int | None, typer.Option(metavar="N", help="Number of seeds.", min=1)] = None,
    pairs: Annotated[int | None, typer.Option(metavar="N", help="Number of pairs.", min=1)] = None,
    seed: FirstSeedOption = None,
    method: MethodsOption = None,
    grid: OwnGridOption = None,
    workers: WorkersOption = 1,
    device: DeviceOption = None,
    as_json: JsonOption = False,
    quiet: QuietOption = False,
) -> None:
    """Run an experiment on simulated scans: one of the paper's, to compare our numbers with the paper's, or one of this
    project's evaluations, to compare methods.

    OUT gets NAME.csv with every row, NAME.md with the tables, NAME*.png with the figures, and the times in
    NAME-seconds.csv, NAME-times.md and NAME.json. If a run is stopped, the same command continues where it stopped;
    finished jobs are kept in OUT/journal.sqlite.
    """
    from kernels.device.device import choose_device
    from spectral.grid import Grid
    from tools.reproduce.pages.page import FRAMES, write_page
    from tools.writers.atomic import require_writable

    if grid is not None:
        Grid(grid, 1.0)
    silent = quiet or as_json
    noises, methods = (tuple(dict.fromkeys(given)) if given else None for given in (sigma2, method))
    asked = Request(None, quick, seeds, seed, grid, scene, noises, pairs, methods)  # pyright: ignore[reportArgumentType]
    names = chosen(name, asked)
    require_writable(out)
    opened = choose_device(device)
    for note in opened.notes:
        say(note)
    options = Options(replace(asked, device=opened), out, fresh, workers, silent)
    records = [_reproduce(experiment, options, printed=not as_json) for experiment in names]
    group = group_of(name)
    written = write_page(page, out, members(group), FRAMES.get(group, FRAMES[ALL])) if page else []
    if as_json:
        typer.echo(json.dumps(_as_json(records, out, written), indent=2, allow_nan=False))
    elif page:
        typer.echo(f"the page is {printable(str(page))}")


@dataclass(frozen=True, slots=True)
class Options:
    """How to run the experiments that are asked for.

    Attributes:
        request: what is asked of them, with the device.
        out: folder for the results.
        fresh: run every job again.
        workers: how many processes share the jobs.
        silent: print no progress.
    """

    request: Request
    out: Path
    fresh: bool
    workers: int
    silent: bool

    def say(self, text: str) -> None:
        """Print the text, unless silent."""
        if not self.silent:
            say(text)


def _reproduce(name: str, options: Options, printed: bool) -> "Record":
    """Run one experiment and write its files; its memory on the device is freed before the next."""
    from tools.reproduce.pages.folder import write_experiment
    from tools.reproduce.provenance import provenance
    from tools.reproduce.run import RunOptions, run

    request, out = options.request, options.out
    experiment = create(name, request)
    origin = provenance(experiment, request.opened)
    follow = partial(progress, quiet=options.silent)
    try:
        result = run(experiment, origin, out, follow, RunOptions(options.fresh, _workers(name, options)), options.say)
    except KeyboardInterrupt:
        options.say("finished jobs are kept; the same command without --fresh continues from there")
        raise
    record = write_experiment(out, experiment, result, origin, request.command(name))
    if printed:
        _print(record, out)
    return record


def _workers(name: str, options: Options) -> "WorkerProcesses | None":
    """The processes for an experiment; None for this process alone."""
    from tools.reproduce.worker import WorkerProcesses

    entry = entry_of(name)
    if options.workers == 1:
        return None
    if entry.timed:
        options.say(f"{name}: measures times, so --workers has no effect; one process runs its jobs")
        return None
    request = replace(options.request, device=None)
    return WorkerProcesses(options.workers, entry.module, request, options.request.opened.selector)


def _print(record: "Record", out: Path) -> None:
    from tools.reproduce.pages.section_text import duration

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
    from tools.writers.json_text import to_json

    return {
        "experiments": [to_json(record) | {"files": [str(out / name) for name in record.files]} for record in records],
        "page": [str(path) for path in page],
    }
