"""The experiments that `sonarmap reproduce` knows: what one is, what its options ask of it, how its jobs are run.

To add one: write a module with a function

    def create(request: Request) -> Experiment:

that makes it from the options (None: the option was not given, so the experiment's own value holds; `as_asked` does
that), add a row to EXPERIMENTS, and say in `tables.py` what is shown of its rows.

Only the standard library is imported here: a worker's process sets the threads of other libraries before it loads them.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from importlib import import_module
from pathlib import Path
from time import perf_counter
from types import MappingProxyType, SimpleNamespace
from typing import TYPE_CHECKING, Any

from sonarmap.kernels.errors import InputError

if TYPE_CHECKING:
    from sonarmap.kernels.device.device import Device

Value = str | int | float | bool
Row = Mapping[str, Value]
Settings = SimpleNamespace  # values of JSON's types by name; with the sources they decide all rows


@dataclass(frozen=True, slots=True)
class Outcome:
    """The results of one job."""

    rows: tuple[Row, ...]  # the same on every run, key by key: they become NAME.csv
    seconds: tuple[Row, ...] = ()  # rows of times: they become NAME-seconds.csv, the file that may differ between runs


@dataclass(frozen=True, slots=True)
class Experiment:
    """An experiment as it was asked for; what is shown of its rows is in `tables.py` and `figures.py`."""

    name: str  # on the command line, and of its files
    settings: Settings
    # Keys of all jobs, in their order. Those that differ in the last part alone, as 3/a and 3/b, share a process.
    jobs: Sequence[str]
    run: Callable[[str], Outcome]  # does one job, whichever were done before
    sources: tuple[str, ...]  # folders and files whose code decides rows, its own module among them
    # Methods that the last part of each job's key names: when the code of one changes, the others' jobs stay done
    methods: tuple[str, ...] = ()
    deciding: tuple[str, ...] = ("edge", "seed")  # settings that decide a method's rows, with the key, code and device
    conclude: Callable[[Sequence[Row]], Sequence[Row]] | None = None  # makes of all rows those that tables show
    write: Callable[[Sequence[Row]], str] | None = None  # stores what was fitted to the rows, and says where


def all_seeds(settings: Settings) -> range:
    """The seeds of the settings, from the first."""
    return range(settings.first_seed, settings.first_seed + settings.seeds)


ALL = "all"  # the paper's experiments
# Sets of pairs -> the options that change them, beside those of every pair
PAIR_SETS = MappingProxyType(
    {"overlap": ("pairs",), "paths": ("scene", "sigma2", "seeds"), "unrelated": ("pairs",)},
)


@dataclass(frozen=True, slots=True)
class Request:
    """What the command line asks for."""

    device: "Device | None" = None  # to run on; None where only the options are looked at
    quick: bool = False  # a minute at most, with less of everything that no option sets
    # seeds, seed: how many, and the first of them
    seeds: int | None = None
    seed: int | None = None
    grid: int | None = None  # voxels per edge
    scene: str | None = None  # a key of SCENE_KINDS
    sigma2: tuple[float, ...] | None = None  # variances of the range noise at the largest range [m^2]
    set: tuple[str, ...] | None = None  # keys of PAIR_SETS
    pairs: int | None = None  # how many
    method: tuple[str, ...] | None = None  # keys of METHODS
    folder: Path | None = None  # of scans, for an experiment that takes one
    voxel: float | None = None  # size of a voxel [m]
    max_tilt: float | None = None  # largest roll and pitch between two scans [degrees]
    known: str | None = None  # instruments, separated by commas, whose measurements are drawn about the truth
    write: bool | None = None  # whether to store what was fitted where the package reads it
    settings: Mapping[str, Any] = field(default_factory=dict[str, Any])  # values of settings that no option sets

    @property
    def opened(self) -> "Device":
        """The device, which is there once an experiment is made."""
        assert self.device is not None
        return self.device

    @property
    def chosen_folder(self) -> Path:
        """The folder, which `chosen` asks for."""
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
        """The command line that asks for the same of one experiment; where the folder lies is left out."""
        options = []
        for option, values in self.given.items():
            shown = [f" {value:g}" if option == "sigma2" else "" if value is True else f" {value}" for value in values]
            options += [f"{_flag(option)}{value}" for value in shown]
        folder = ["DIR"] if self.folder is not None else []
        return " ".join(["sonarmap reproduce", name, *folder, *(["--quick"] if self.quick else []), *options])


# The options that not every experiment has, in the order in which a command line shows them
OPTIONS = (
    "scene", "grid", "voxel", "max_tilt", "known", "sigma2", "seeds", "set", "pairs", "seed", "method",
    "write",
)  # fmt: skip


@dataclass(frozen=True, slots=True)
class ExperimentEntry:
    """One experiment of the table."""

    shows: str  # which of the paper's figures and tables, or what is measured
    module: str  # has `create`, or another function behind a colon; it is imported when the experiment is asked for
    options: tuple[str, ...]  # those of OPTIONS that change its rows
    timed: bool = False  # whether it measures times, so that its jobs are run one by one
    folder: str = ""  # what the folder that it takes holds


_HERE = "sonarmap.tools.lab.reproduce"
_STRUCTURES = ("scene", "grid", "seeds", "seed")
_PAIRS = ("grid", "pairs", "seed", "method")
_MADE_UP = "the mapper's own work on 1,000 to 10,000 scans, with made-up registrations"
_SCANS = "scans whose names end in a number and a gt.log, or several folders of such"
_JOURNALS = "the registrations that earlier runs made, or nothing yet"
PAPER = ("translation", "rotation", "limits", "gaussian", "floodgate")
EXPERIMENTS: Mapping[str, ExperimentEntry] = MappingProxyType(
    {
        "translation": ExperimentEntry("Figs. 12, 14, 15", f"{_HERE}.structures:create_translation", _STRUCTURES),
        "rotation": ExperimentEntry("Figs. 16, 17", f"{_HERE}.structures:create_rotation", _STRUCTURES),
        "limits": ExperimentEntry("Figs. 7 to 9", f"{_HERE}.structures:create_limits", _STRUCTURES),
        "gaussian": ExperimentEntry("Table 1, Figs. 20, 21", f"{_HERE}.gaussian", (*_STRUCTURES, "sigma2")),
        "floodgate": ExperimentEntry("Sect. 4, Table 2, Figs. 22 to 31", f"{_HERE}.floodgate", _STRUCTURES[1:]),
        "pairs": ExperimentEntry(
            "pairs of every overlap, along paths, and of unrelated scans",
            f"{_HERE}.pairs",
            (*_PAIRS, "set", "scene", "sigma2", "seeds"),
        ),
        "kinds": ExperimentEntry("pairs of every kind of scan", f"{_HERE}.kinds", _PAIRS),
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
)


def chosen(name: str, request: Request) -> tuple[str, ...]:
    """The experiments that a name means: itself, or all of the paper's.

    Raises InputError: there is no such experiment, an option or a folder has no effect on it, or it needs a folder.
    """
    if name not in (*EXPERIMENTS, ALL):
        raise InputError(f"no experiment is called {name!r}; there are {', '.join((*EXPERIMENTS, ALL))}")
    names = PAPER if name == ALL else (name,)
    _check_folder(name, EXPERIMENTS[names[0]].folder, request.folder)
    options = [option for option in OPTIONS if all(option in EXPERIMENTS[member].options for member in names)]
    if request.set:
        of_sets = {option for chosen_set in request.set for option in PAIR_SETS[chosen_set]}
        options = [option for option in options if option in ("grid", "set", "seed", "method") or option in of_sets]
    idle = [_flag(option) for option in request.given if option not in options]
    if idle:
        known = ", ".join(_flag(option) for option in options)
        verb, pronoun = ("has", "it") if len(idle) == 1 else ("have", "them")
        raise InputError(
            f"{' and '.join(idle)} {verb} no effect on reproduce {name}; leave {pronoun} out"
            + (f". It takes {known}" if known else "")
        )
    return names


# An option -> the settings that it changes, of those that an experiment has
_CHANGED_BY = {
    "scene": ("scene", "scenes"),
    "grid": ("edge", "edges"),
    "sigma2": ("sigma2",),
    "seeds": ("seeds",),
    "seed": ("seed", "first_seed"),
    "pairs": ("pairs",),
    "voxel": ("voxel",),
    "max_tilt": ("max_tilt",),
}


def as_asked(request: Request, usual: Mapping[str, Any], quick: Mapping[str, Any]) -> Settings:
    """The usual settings, changed by the options, and by `quick` of a quick run where no option does."""
    values = {**usual, **(quick if request.quick else {})}
    for option, names in _CHANGED_BY.items():
        value = getattr(request, option)
        for name in (name for name in names if name in values and value is not None):
            is_list = isinstance(usual[name], tuple) and not isinstance(value, tuple)
            values[name] = (value,) if is_list else value
    return Settings(**values | dict(request.settings))


def create(name: str, request: Request) -> Experiment:
    """The experiment of that name."""
    return create_from(EXPERIMENTS[name].module, request)


def create_from(place: str, request: Request) -> Experiment:
    """The experiment that a module's `create` makes, or another function of it, as in "module:create_rotation"."""
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


_experiment: Experiment | None = None  # of this process, where it is a worker


@dataclass(frozen=True, slots=True)
class WorkerProcesses:
    """New processes that each make the same experiment, with a device of its own."""

    count: int  # how many, at least 1
    module: str  # has the experiment's `create`, as `create_from` takes it
    request: Request  # what to make, without a device
    device: str | None  # as `choose_device` takes it


@dataclass(frozen=True, slots=True)
class JobResult:
    """A job that was run."""

    job: str  # its key
    outcome: Outcome
    seconds: float  # wall time


def begin(processes: WorkerProcesses) -> None:
    """Make the experiment in a new process."""
    global _experiment
    from sonarmap.kernels.device.device import choose_device

    _experiment = create_from(processes.module, replace(processes.request, device=choose_device(processes.device)))


def run_in_worker(groups: Sequence[Sequence[str]]) -> list[list[JobResult]]:
    """Run groups of jobs by the experiment of this process, which `begin` made."""
    assert _experiment is not None, "`begin` was not called in this process"
    return run_jobs(_experiment, groups)


def run_jobs(experiment: Experiment, groups: Sequence[Sequence[str]]) -> list[list[JobResult]]:
    """Run the jobs of each group, one after the other."""
    return [[_run(experiment, job) for job in group] for group in groups]


def _run(experiment: Experiment, job: str) -> JobResult:
    start = perf_counter()
    outcome = experiment.run(job)
    return JobResult(job, outcome, perf_counter() - start)
