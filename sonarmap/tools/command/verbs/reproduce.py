"""`sonarmap reproduce`: the paper's experiments on simulated scans, evaluations on unseen pairs, whole surveys."""

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from sonarmap.tools.command.failures import when_stopped
from sonarmap.tools.command.method import VoxelOption, check_seed, check_tilt
from sonarmap.tools.command.option import (
    EXPERIMENT,
    MOST_WORKERS,
    OUTPUT,
    RUNNING,
    DeviceOption,
    JsonOption,
    QuietOption,
    checked,
    refused_by,
)
from sonarmap.tools.command.terminal import print_json, printable, progress, result_console, say
from sonarmap.tools.lab.reproduce.experiments import ALL, EXPERIMENTS, PAIR_SETS, PAPER, Request, chosen, create
from sonarmap.tools.lab.simulate.scenes.catalog import SCENE_KINDS
from sonarmap.tools.methods.registry import METHODS, find_method

if TYPE_CHECKING:
    from sonarmap.tools.lab.reproduce.experiments import WorkerProcesses
    from sonarmap.tools.lab.reproduce.folder import Record


_NAMES = "; ".join(f"{name} ({entry.shows})" for name, entry in EXPERIMENTS.items())
# Steps and noise of the experiments fit the paper's 256 m and are too large for a small scene.
SCENES = [name for name, kind in SCENE_KINDS.items() if kind.scale == 1.0]
_rare = partial(EXPERIMENT.option, rare=True)

NameArgument = Annotated[
    str,
    typer.Argument(
        help=f"An experiment, or '{ALL}' for the paper's. There are {_NAMES}. The paper's are {', '.join(PAPER)}.",
        metavar="NAME",
    ),
]
FolderArgument = Annotated[
    Path | None,
    typer.Argument(
        help="For real: a folder with scans and a gt.log, or a folder of such folders. For decisions: the "
        "folder of stored registrations.",
        metavar="DIR",
        show_default=False,
    ),
]


@dataclass(frozen=True, slots=True)
class ExperimentOptions:
    """Options of the experiments, with the names of `Request`'s fields; None for an experiment's own default."""

    quick: bool = EXPERIMENT.flag(
        "--quick",
        "Take at most a minute for each experiment, with fewer scenes, seeds, pairs and voxels unless given.",
    )
    scene: str | None = _rare(
        "SCENE",
        f"The scene: {', '.join(SCENES)}.",
        callback=checked(
            SCENES.__contains__, f"{{}} is not a scene as large as the paper's; choose {', '.join(SCENES)}"
        ),
    )
    sigma2: list[float] | None = _rare(
        "V",
        "Variance of the range noise at the largest range \\[m^2]; may be repeated.",
        callback=checked(
            lambda values: all(0 <= value < math.inf for value in values), "{} m^2; variances must be 0 or more"
        ),
    )
    seeds: int | None = _rare("N", "Number of seeds.", min=1)
    set: list[str] | None = _rare(
        "NAME",
        "For pairs: overlap (all overlaps), paths (Table 1, extended) or unrelated; may be repeated.",
        callback=checked(lambda names: PAIR_SETS.keys() >= {*names}, f"{{}}; choose from {', '.join(PAIR_SETS)}"),
        shown="all",
    )
    pairs: int | None = _rare("N", "Number of pairs.", min=1)
    seed: int | None = _rare(
        "S", "The first seed, or the seed of the pairs; the same seed gives the same results.", callback=check_seed
    )
    method: list[str] | None = EXPERIMENT.option(
        "NAME",
        f"A method to evaluate; may be repeated. Methods: {', '.join(METHODS)}.",
        callback=refused_by(lambda names: [find_method(name) for name in names]),
    )
    grid: int | None = EXPERIMENT.option(
        "N", "Voxels per edge, 16..512: an even product of 2, 3 and 5.", shown="the experiment's"
    )
    voxel: VoxelOption = None
    max_tilt: float | None = _rare(
        "DEG",
        "For real: largest roll and pitch between two scans \\[deg], up to 180 (no limit).",
        shown="35",
        callback=check_tilt,
    )
    known: str | None = _rare(
        "WHAT",
        "For real: also register every pair with measurements of WHAT, simulated from the truth: "
        "attitude,heading,depth,position, or some of them (to 1.5 deg, 3 deg, 0.15 m, 3 m).",
    )
    write: bool = EXPERIMENT.flag(
        "--write", "For confidence: store the fitted model in the package, which then uses it."
    )


@dataclass(frozen=True, slots=True)
class ExperimentRun:
    """Options of the folder for results and of the processes."""

    out: Path = OUTPUT.option(
        "OUT",
        "Folder for the results. A stopped run continues from its finished jobs.",
        Path("reproduction"),
        "-o",
        "--out",
    )
    fresh: bool = RUNNING.flag("--fresh", "Run all jobs again, finished ones too.")
    workers: int = RUNNING.option(
        "N", "Processes that share the jobs. The results are the same.", 1, min=1, max=MOST_WORKERS
    )


def command(
    name: NameArgument,
    options: ExperimentOptions,
    run: ExperimentRun,
    folder: FolderArgument = None,
    device: DeviceOption = None,
    as_json: JsonOption = False,
    quiet: QuietOption = False,
) -> None:
    """Run the paper's experiments, or evaluations of methods.

    Experiments on simulated scans are the paper's, to compare our numbers with its numbers, or this project's
    evaluations of methods. 'reproduce real DIR' compares methods on your own scans.

    OUT gets NAME.csv with every row, NAME.md with the tables, and the times in NAME-seconds.csv, NAME-times.md and
    NAME.json. The same command continues a run that was stopped; finished jobs are kept in OUT/journal.sqlite.
    """
    from sonarmap.kernels.device.device import choose_device
    from sonarmap.spectral.grid import Grid
    from sonarmap.tools.extras import require
    from sonarmap.tools.files.writers.atomic import require_writable

    require("pandas")
    if options.grid is not None:
        Grid(options.grid, 1.0)
    several = {name: _each_once(getattr(options, name)) for name in ("sigma2", "set", "method")}
    # pyrefly: ignore[bad-argument-type]
    request = Request(folder=folder, **{**asdict(options), **several, "write": options.write or None})
    names = chosen(name, request)
    require_writable(run.out)
    opened = choose_device(device)
    for note in opened.notes:
        say(note)
    job = ExperimentJob(replace(request, device=opened), run, quiet or as_json)
    records = [_reproduce(experiment, job, printed=not as_json) for experiment in names]
    if as_json:
        print_json(_as_json(records, run.out), indent=2)


def _each_once(values: Sequence[Any] | None) -> tuple[Any, ...] | None:
    return tuple(dict.fromkeys(values)) if values else None


@dataclass(frozen=True, slots=True)
class ExperimentJob:
    """What a run of experiments has in common."""

    request: Request  # options of the experiments, with the device
    run: ExperimentRun  # folder and processes
    silent: bool  # print no progress

    def say(self, text: str) -> None:
        """Print the text, unless silent."""
        if not self.silent:
            say(text)


def _reproduce(name: str, job: ExperimentJob, printed: bool) -> "Record":
    """Run an experiment and write its files; its device memory is freed before the next."""
    from sonarmap.tools.lab.reproduce.folder import write_experiment
    from sonarmap.tools.lab.reproduce.run import RunOptions, provenance, run

    request, out = job.request, job.run.out
    experiment = create(name, request)
    origin = provenance(experiment, request.opened)
    follow = partial(progress, quiet=job.silent)
    with when_stopped(lambda: f"finished jobs are kept in {out}; the same command continues from there"):
        result = run(experiment, origin, out, follow, RunOptions(job.run.fresh, _workers(name, job)), job.say)
    shown = experiment.conclude(result.rows) if experiment.conclude else result.rows
    record = write_experiment(out, experiment, result, shown, origin, request.command(name))
    if printed:
        _print(record, out)
    if request.write and experiment.write:
        job.say(experiment.write(shown))
    return record


def _workers(name: str, job: ExperimentJob) -> "WorkerProcesses | None":
    """The worker processes of an experiment; None for this process alone."""
    from sonarmap.tools.lab.reproduce.experiments import WorkerProcesses

    if job.run.workers == 1:
        return None
    if EXPERIMENTS[name].timed:
        job.say(f"{name}: measures times, so --workers has no effect; one process runs its jobs")
        return None
    request = replace(job.request, device=None)
    return WorkerProcesses(job.run.workers, EXPERIMENTS[name].module, request, job.request.opened.selector)


def _print(record: "Record", out: Path) -> None:
    from sonarmap.tools.lab.reproduce.folder import duration
    from sonarmap.tools.lab.terminal import plain_table

    console = result_console()
    console.print(record.title, style="bold", markup=False)
    console.print()
    for table in (*record.tables, *record.times):
        console.print(plain_table(table.headings, table.rows, table.title))
        console.print()
    files = ", ".join(printable(str(out / name)) for name in record.files)
    typer.echo(f"{record.jobs} jobs in {duration(record.seconds)}; in {files}")


def _as_json(records: "Sequence[Record]", out: Path) -> dict[str, object]:
    from sonarmap.tools.files.writers.tables import to_json

    return {"experiments": [to_json(record) | {"files": [out / name for name in record.files]} for record in records]}
