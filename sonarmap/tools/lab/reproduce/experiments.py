"""The experiments of `sonarmap reproduce`: their types, options and jobs.

To add an experiment, write a module with a function

    def create(request: Request) -> Experiment:

that creates it from the options (None: the option was not given, and the experiment's default holds, as `as_asked`
implements), add a row to EXPERIMENTS, and add its tables to `tables.py`.

This module imports only the standard library, as a worker sets the threads of other libraries before it loads them.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from importlib import import_module
from pathlib import Path
from time import perf_counter
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

from sonarmap.kernels.errors import InputError

if TYPE_CHECKING:
    from sonarmap.kernels.device.device import Device

Value = str | int | float | bool
Row = Mapping[str, Value]
Settings = SimpleNamespace  # values of JSON types by name; they and the sources determine all rows


@dataclass(frozen=True, slots=True)
class Outcome:
    """The results of one job."""

    rows: tuple[Row, ...]  # the same on every run; written to NAME.csv
    seconds: tuple[Row, ...] = ()  # run times, which differ between runs; written to NAME-seconds.csv


@dataclass(frozen=True, slots=True)
class Experiment:
    """An experiment with its settings; `tables.py` has its tables."""

    name: str  # on the command line and of the files
    settings: Settings
    # Keys of all jobs, in order. Jobs that differ only in the last part of their keys, as 3/a and 3/b, share a process.
    jobs: Sequence[str]
    run: Callable[[str], Outcome]  # runs a job, independently of other jobs
    sources: tuple[str, ...]  # folders and files whose code affects the rows, including its own module
    # Methods named by the last part of the jobs' keys: a change in the code of one keeps the results of the others
    methods: tuple[str, ...] = ()
    deciding: tuple[str, ...] = ("edge", "seed")  # settings that affect a method's rows, beside key, code and device
    conclude: Callable[[Sequence[Row]], Sequence[Row]] | None = None  # computes the rows of the tables from all rows
    write: Callable[[Sequence[Row]], str] | None = None  # stores what was fitted to the rows, and returns a message


def all_seeds(settings: Settings) -> range:
    """The `seeds` consecutive seeds of the settings from `first_seed` on."""
    return range(settings.first_seed, settings.first_seed + settings.seeds)


ALL = "all"  # the paper's experiments
# Set of pairs -> options that apply to it, beside those of all sets
PAIR_SETS = {"overlap": ("pairs",), "paths": ("scene", "sigma2", "seeds"), "unrelated": ("pairs",)}


@dataclass(frozen=True, slots=True)
class Request:
    """The options of the command line; None if not given."""

    device: "Device | None" = None  # to run on; None if only the options are checked
    quick: bool = False  # reduce everything that no option sets, to a minute at most
    seeds: int | None = None  # number of seeds
    seed: int | None = None  # the first seed
    grid: int | None = None  # voxels per edge
    scene: str | None = None  # a key of SCENE_KINDS
    sigma2: tuple[float, ...] | None = None  # variances of the range noise at the largest range [m^2]
    set: tuple[str, ...] | None = None  # keys of PAIR_SETS
    pairs: int | None = None  # number of pairs
    method: tuple[str, ...] | None = None  # keys of METHODS
    folder: Path | None = None  # of input, for an experiment that takes one
    voxel: float | None = None  # size of a voxel [m]
    max_tilt: float | None = None  # largest roll and pitch between two scans [degrees]
    known: str | None = None  # instruments with simulated measurements, separated by commas
    write: bool | None = None  # whether to store what was fitted in the package
    settings: Mapping[str, Any] = field(default_factory=dict[str, Any])  # values of settings that no option sets

    @property
    def opened(self) -> "Device":
        """The device, which is set when an experiment is created."""
        assert self.device is not None
        return self.device

    @property
    def chosen_folder(self) -> Path:
        """The folder, which `chosen` has checked."""
        assert self.folder is not None
        return self.folder

    @property
    def given(self) -> dict[str, tuple[object, ...]]:
        """The options of OPTIONS that were given, with their values."""
        values = {name: getattr(self, name) for name in OPTIONS}
        return {
            name: value if isinstance(value, tuple) else (value,) for name, value in values.items() if value is not None
        }

    def command(self, name: str) -> str:
        """The command line that runs one experiment with these options, with DIR for the folder."""
        options = []
        for option, values in self.given.items():
            shown = [f" {value:g}" if option == "sigma2" else "" if value is True else f" {value}" for value in values]
            options += [f"{_flag(option)}{value}" for value in shown]
        folder = ["DIR"] if self.folder is not None else []
        return " ".join(["sonarmap reproduce", name, *folder, *(["--quick"] if self.quick else []), *options])


# Options that only some experiments take, in the order of `Request.command` -> the settings that `as_asked` gives their
# value, if the experiment has them
OPTIONS: Mapping[str, tuple[str, ...]] = {
    "scene": ("scene", "scenes"),
    "grid": ("edge", "edges"),
    "voxel": ("voxel",),
    "max_tilt": ("max_tilt",),
    "known": (),
    "sigma2": ("sigma2",),
    "seeds": ("seeds",),
    "set": (),
    "pairs": ("pairs",),
    "seed": ("seed", "first_seed"),
    "method": (),
    "write": (),
}


@dataclass(frozen=True, slots=True)
class ExperimentEntry:
    """A row of EXPERIMENTS."""

    shows: str  # the paper's figures and tables, or what is measured
    module: str  # "module" with `create`, or "module:function"; imported when the experiment is chosen
    options: tuple[str, ...]  # those of OPTIONS that it takes
    timed: bool = False  # whether it measures times, so that its jobs run one at a time
    folder: str = ""  # content of the folder that it takes; "" for none


_HERE = "sonarmap.tools.lab.reproduce"
_PAPER_SCANS = f"{_HERE}.paper_scans"
_STRUCTURES = ("scene", "grid", "seeds", "seed")
_PAIRS = ("grid", "pairs", "seed", "method")
_MADE_UP = "the mapper's own work on 1,000 to 10,000 scans, with made-up registrations"
_SCANS = "scans whose names end in a number and a gt.log, or several such folders"
_JOURNALS = "registrations of earlier runs, or nothing yet"
PAPER = ("translation", "rotation", "limits", "gaussian", "floodgate")
EXPERIMENTS: Mapping[str, ExperimentEntry] = {
    "translation": ExperimentEntry("Figs. 12, 14, 15", f"{_HERE}.structures:create_translation", _STRUCTURES),
    "rotation": ExperimentEntry("Figs. 16, 17", f"{_HERE}.structures:create_rotation", _STRUCTURES),
    "limits": ExperimentEntry("Figs. 7 to 9", f"{_HERE}.structures:create_limits", _STRUCTURES),
    "gaussian": ExperimentEntry("Table 1, Figs. 20, 21", f"{_PAPER_SCANS}:create_gaussian", (*_STRUCTURES, "sigma2")),
    "floodgate": ExperimentEntry(
        "Sect. 4, Table 2, Figs. 22 to 31", f"{_PAPER_SCANS}:create_floodgate", _STRUCTURES[1:]
    ),
    "pairs": ExperimentEntry(
        "pairs of every overlap, along paths, and of unrelated scans",
        f"{_HERE}.pairs",
        (*_PAIRS, "set", "scene", "sigma2", "seeds"),
    ),
    "kinds": ExperimentEntry("pairs of every kind of scan", f"{_HERE}.pairs:create_kinds", _PAIRS),
    "real": ExperimentEntry(
        "pairs of real scans in a folder DIR",
        f"{_HERE}.real",
        ("grid", "voxel", "max_tilt", "known", "seeds", "seed", "method"),
        folder=_SCANS,
    ),
    "survey": ExperimentEntry("maps of whole surveys", f"{_HERE}.survey", _STRUCTURES, timed=True),
    "scale": ExperimentEntry(_MADE_UP, f"{_HERE}.scale", ("seeds", "seed"), timed=True),
    "decisions": ExperimentEntry(
        "thresholds of the graph, with registrations that a folder DIR keeps",
        f"{_HERE}.survey:create_decisions",
        _STRUCTURES[1:],
        folder=_JOURNALS,
    ),
    "confidence": ExperimentEntry(
        "the probability and covariance of registrations, fitted to pairs of every kind",
        f"{_HERE}.confidence",
        (*_PAIRS[:-1], "write"),
    ),
}


def chosen(name: str, request: Request) -> tuple[str, ...]:
    """The experiments that a name selects: the one of that name, or all of the paper's.

    Raises InputError: the experiment is unknown, an option or a folder has no effect on it, or it needs a folder.
    """
    if name not in (*EXPERIMENTS, ALL):
        raise InputError(f"no experiment is called {name!r}; there are {', '.join((*EXPERIMENTS, ALL))}")
    names = PAPER if name == ALL else (name,)
    _check_folder(name, EXPERIMENTS[names[0]].folder, request.folder)
    options = [option for option in OPTIONS if all(option in EXPERIMENTS[member].options for member in names)]
    if request.set:
        of_sets = {option for chosen_set in request.set for option in PAIR_SETS[chosen_set]}
        options = [option for option in options if option in ("grid", "set", "seed", "method") or option in of_sets]
    unused = [_flag(option) for option in request.given if option not in options]
    if unused:
        accepted = ", ".join(_flag(option) for option in options)
        verb, pronoun = ("has", "it") if len(unused) == 1 else ("have", "them")
        raise InputError(
            f"{' and '.join(unused)} {verb} no effect on reproduce {name}; leave {pronoun} out"
            + (f". It takes {accepted}" if accepted else "")
        )
    return names


def as_asked(request: Request, usual: Mapping[str, Any], quick: Mapping[str, Any]) -> Settings:
    """The `usual` settings, changed by those of `quick` in a quick run, and then by the options."""
    values = {**usual, **(quick if request.quick else {})}
    for option, names in OPTIONS.items():
        value = getattr(request, option)
        for name in (name for name in names if name in values and value is not None):
            is_list = isinstance(usual[name], tuple) and not isinstance(value, tuple)
            values[name] = (value,) if is_list else value
    return Settings(**values | dict(request.settings))


def create(name: str, request: Request) -> Experiment:
    """The experiment of that name."""
    return create_from(EXPERIMENTS[name].module, request)


def create_from(place: str, request: Request) -> Experiment:
    """The experiment that "module" creates by `create`, or "module:function" by that function."""
    module, _, function = place.partition(":")
    return getattr(import_module(module), function or "create")(request)


def _check_folder(name: str, holds: str, folder: Path | None) -> None:
    if holds and folder is None:
        raise InputError(f"reproduce {name} needs a folder: sonarmap reproduce {name} DIR; DIR holds {holds}")
    if folder is not None and not holds:
        raise InputError(
            f"reproduce {name} simulates its scans, so the folder {folder} has no effect on it; leave it out, or give "
            "-o before it if the results are to go there"
        )


def _flag(option: str) -> str:
    return f"--{option.replace('_', '-')}"


JobResult = tuple[str, Outcome, float]  # key of a job, its outcome, wall time [s]
_experiment: Experiment | None = None  # of this process, if it is a worker


@dataclass(frozen=True, slots=True)
class WorkerProcesses:
    """The specification of worker processes, which each create the experiment with their own device."""

    count: int  # at least 1
    module: str  # of the experiment, for `create_from`
    request: Request  # the options, without a device
    device: str | None  # selector for `choose_device`

    def begin(self) -> None:
        """Create the experiment of this worker process."""
        global _experiment
        from sonarmap.kernels.device.device import choose_device

        _experiment = create_from(self.module, replace(self.request, device=choose_device(self.device)))

    @staticmethod
    def run(jobs: Sequence[str]) -> list[JobResult]:
        """Run jobs of the experiment that `begin` created in this process."""
        assert _experiment is not None, "`begin` was not called in this process"
        return [run_job(_experiment, job) for job in jobs]


def run_job(experiment: Experiment, job: str) -> JobResult:
    """Run a job in this process."""
    start = perf_counter()
    outcome = experiment.run(job)
    return job, outcome, perf_counter() - start
