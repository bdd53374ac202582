"""`sonarmap reproduce`: the paper's experiments on simulated scans, evaluations on unseen pairs, whole surveys."""

import json
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from sonarmap.tools.command.options.experiment import (
    FirstSeedOption,
    FolderArgument,
    FreshOption,
    KnownOption,
    KnownSigmasOption,
    MethodsOption,
    NameArgument,
    NoisesOption,
    OutOption,
    OwnGridOption,
    OwnTiltOption,
    PageOption,
    PairsOption,
    QuickOption,
    SceneOption,
    SeedsOption,
    WorkersOption,
)
from sonarmap.tools.command.options.registration import DeviceOption, JsonOption, QuietOption, VoxelOption
from sonarmap.tools.command.progress import progress
from sonarmap.tools.command.stops import when_stopped
from sonarmap.tools.command.terminal import printable, result_console, say
from sonarmap.tools.lab.reproduce.experiments import Request, chosen, create, entry_of, group_of

if TYPE_CHECKING:
    from sonarmap.tools.lab.reproduce.pages.folder import Record
    from sonarmap.tools.lab.reproduce.worker import WorkerProcesses


def command(
    name: NameArgument,
    folder: FolderArgument = None,
    out: OutOption = Path("reproduction"),
    quick: QuickOption = False,
    fresh: FreshOption = False,
    page: PageOption = None,
    scene: SceneOption = None,
    sigma2: NoisesOption = None,
    seeds: SeedsOption = None,
    pairs: PairsOption = None,
    seed: FirstSeedOption = None,
    method: MethodsOption = None,
    grid: OwnGridOption = None,
    voxel: VoxelOption = None,
    max_tilt: OwnTiltOption = None,
    known: KnownOption = None,
    known_sigmas: KnownSigmasOption = None,
    workers: WorkersOption = 1,
    device: DeviceOption = None,
    as_json: JsonOption = False,
    quiet: QuietOption = False,
) -> None:
    """Run the paper's experiments, or evaluations of methods.

    An experiment on simulated scans is one of the paper's, to compare our numbers with the paper's, or one of this
    project's evaluations, to compare methods. 'reproduce real DIR' compares methods on your own scans.

    OUT gets NAME.csv with every row, NAME.md with the tables, NAME*.png with the figures, and the times in
    NAME-seconds.csv, NAME-times.md and NAME.json. If a run is stopped, the same command continues where it stopped;
    finished jobs are kept in OUT/journal.sqlite.
    """
    from sonarmap.kernels.device.device import choose_device
    from sonarmap.spectral.grid import Grid
    from sonarmap.tools.files.writers.atomic import require_writable
    from sonarmap.tools.lab.reproduce.pages.page import write_pages

    if grid is not None:
        Grid(grid, 1.0)
    silent = quiet or as_json
    noises = tuple(dict.fromkeys(sigma2)) if sigma2 else None
    methods = tuple(dict.fromkeys(method)) if method else None
    asked = Request(
        None, quick, seeds, seed, grid, scene, noises, pairs, methods, folder, voxel, max_tilt, known, known_sigmas
    )
    names = chosen(name, asked)
    require_writable(out)
    opened = choose_device(device)
    for note in opened.notes:
        say(note)
    options = Options(replace(asked, device=opened), out, fresh, workers, silent)
    records = [_reproduce(experiment, options, printed=not as_json) for experiment in names]
    written = write_pages(page, out, group_of(name)) if page else []
    if as_json:
        typer.echo(json.dumps(_as_json(records, out, written), indent=2, allow_nan=False))
    elif page:
        typer.echo(f"the {'pages are in' if page.is_dir() else 'page is'} {printable(str(page))}")


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
    from sonarmap.tools.lab.reproduce.pages.folder import write_experiment
    from sonarmap.tools.lab.reproduce.provenance import provenance
    from sonarmap.tools.lab.reproduce.run import RunOptions, run

    request, out = options.request, options.out
    experiment = create(name, request)
    origin = provenance(experiment, request.opened)
    follow = partial(progress, quiet=options.silent)
    with when_stopped(lambda: f"finished jobs are kept in {out}; the same command continues from there"):
        result = run(experiment, origin, out, follow, RunOptions(options.fresh, _workers(name, options)), options.say)
    record = write_experiment(out, experiment, result, origin, request.of(name).command(name))
    if printed:
        _print(record, out)
    return record


def _workers(name: str, options: Options) -> "WorkerProcesses | None":
    """The processes for an experiment; None for this process alone."""
    from sonarmap.tools.lab.reproduce.worker import WorkerProcesses

    entry = entry_of(name)
    if options.workers == 1:
        return None
    if entry.timed:
        options.say(f"{name}: measures times, so --workers has no effect; one process runs its jobs")
        return None
    request = replace(options.request.of(name), device=None)
    return WorkerProcesses(options.workers, entry.module, request, options.request.opened.selector)


def _print(record: "Record", out: Path) -> None:
    from sonarmap.tools.lab.reproduce.pages.section_text import duration

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
    from sonarmap.tools.files.writers.json_text import to_json

    return {
        "experiments": [to_json(record) | {"files": [str(out / name) for name in record.files]} for record in records],
        "page": [str(path) for path in page],
    }
