"""`sonarmap reproduce`: the paper's experiments on simulated scans, and an evaluation on unseen ones."""

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
    from tools.reproduce.crew import Crew
    from tools.reproduce.pages.folder import Record

_SHOWN = "; ".join(
    f"{group}: each in turn of {', '.join(f'{name} ({EXPERIMENTS[name].shows})' for name in members(group))}"
    for group in groups()
)

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
        "--page",
        metavar="FILE",
        help="Then write a page on all experiments of the group in OUT, as in docs/reproduction.md.",
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
        help=f"Of the evaluation: a method, {', '.join(METHODS)}; may be repeated.",
        callback=_check_methods,
    ),
]
WorkersOption = Annotated[
    int,
    typer.Option("--workers", metavar="N", min=1, help="Processes that share the jobs; the results stay the same."),
]
FirstSeedOption = Annotated[
    int | None,
    typer.Option("--seed", metavar="S", help="The first of them; same seed, same result.", callback=check_seed),
]


def command(
    name: Annotated[str, typer.Argument(help=f"{_SHOWN}.", metavar="NAME")],
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
    pairs: Annotated[int | None, typer.Option(metavar="N", help="How many pairs.", min=1)] = None,
    seed: FirstSeedOption = None,
    method: MethodsOption = None,
    grid: OwnGridOption = None,
    workers: WorkersOption = 1,
    device: DeviceOption = None,
    as_json: JsonOption = False,
    quiet: QuietOption = False,
) -> None:
    """Repeat an experiment of the paper on simulated scans, and show its numbers beside the paper's; or one of the
    evaluation, beside other methods.

    OUT gets NAME.csv with every row, NAME.md with the tables, NAME*.png with figures like the paper's, and the times in
    NAME-seconds.csv, NAME-times.md and NAME.json. A run that was stopped goes on where it was when the same command is
    given again.
    """
    from kernels.opencl.device import choose_device
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
    run = Run(replace(asked, device=opened), out, fresh, workers, silent)
    records = [_reproduce(one, run, printed=not as_json) for one in names]
    group = group_of(name)
    written = write_page(page, out, members(group), FRAMES.get(group, FRAMES[ALL])) if page else []
    if as_json:
        typer.echo(json.dumps(_as_json(records, out, written), indent=2, allow_nan=False))
    elif page:
        typer.echo(f"the page is {printable(str(page))}")


@dataclass(frozen=True, slots=True)
class Run:
    """How to run each of the experiments that are asked for.

    Attributes:
        request: what is asked of them, with the device.
        out: folder for the results.
        fresh: do every job again.
        workers: how many processes share the jobs.
        silent: tell nothing of the progress.
    """

    request: Request
    out: Path
    fresh: bool
    workers: int
    silent: bool

    def crew(self, name: str) -> "Crew | None":
        """The processes for an experiment; None for this process alone."""
        from tools.reproduce.crew import Crew

        entry = entry_of(name)
        if self.workers == 1:
            return None
        if entry.timed:
            self.tell(f"{name}: measures times, so --workers does not count: one process does its jobs")
            return None
        return Crew(self.workers, entry.module, replace(self.request, device=None), self.request.opened.selector)

    def tell(self, words: str) -> None:
        """Say it, if anything is to be said."""
        if not self.silent:
            say(words)


def _reproduce(name: str, wanted: Run, printed: bool) -> "Record":
    """Run one experiment and write its files; what it holds on the device is let go before the next."""
    from tools.reproduce.method_source import method_provenances
    from tools.reproduce.pages.folder import write_experiment
    from tools.reproduce.provenance import provenance
    from tools.reproduce.run import Way, run

    request, out = wanted.request, wanted.out
    experiment = create(name, request)
    origin = provenance(experiment, request.opened)
    way = Way(wanted.fresh, wanted.crew(name), method_provenances(experiment, request.opened))
    follow = partial(progress, quiet=wanted.silent)
    try:
        result = run(experiment, origin, out, follow, way, wanted.tell)
    except KeyboardInterrupt:
        wanted.tell("the jobs that were done are kept; the same command without --fresh goes on from there")
        raise
    record = write_experiment(out, experiment, result, origin, request.command(name))
    if printed:
        _print(record, out)
    return record


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
