"""The experiments that `sonarmap reproduce` knows, and what its options ask of them.

To add one: write a module with a class that is an `Experiment` (tools/lab/reproduce/experiment.py) and a function

    def create(request: Request) -> Experiment:

that makes it from the options (None: the option was not given, so the experiment's own value holds; `settings.as_asked`
does that), and add a row to EXPERIMENTS. Files that `provenance.SHOWING` names, as section.py and figure.py, only show
rows: changing them does not make jobs run again; changing the file of the class, or what its `sources` name, does.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from importlib import import_module
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING

from sonarmap.kernels.errors import InputError

if TYPE_CHECKING:
    from sonarmap.kernels.device.device import Device
    from sonarmap.tools.lab.reproduce.experiment import Experiment

# Groups of experiments
ALL = "all"  # the paper's
EVALUATION = "evaluation"  # on pairs that had no part in development
SLAM = "slam"  # of whole surveys
REAL = "real"  # on scans of a folder
SCALE = "scale"  # of growth
KINDS = "kinds"  # on every kind of scan that is simulated
EVIDENCE = "evidence"  # of what registrations measure
FITTING = "judge"  # of how far to believe them
DECIDING = "decisions"  # of what maps are made of them


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
    pairs: int | None = None  # how many
    method: tuple[str, ...] | None = None  # keys of METHODS
    folder: Path | None = None  # of scans, for an experiment that takes one
    voxel: float | None = None  # size of a voxel [m]
    max_tilt: float | None = None  # largest roll and pitch between two scans [degrees]
    known: str | None = None  # instruments, separated by commas, whose measurements are drawn about the truth
    known_sigmas: str | None = None  # their standard deviations, as the option is written
    write: bool | None = None  # whether to write what was fitted where the package reads it

    @property
    def opened(self) -> "Device":
        """The device, which is there once an experiment is made."""
        if self.device is None:
            raise ValueError("no device was chosen")
        return self.device

    @property
    def chosen_folder(self) -> Path:
        """The folder, which is there where an experiment on one is made."""
        if self.folder is None:
            raise ValueError("no folder was chosen")
        return self.folder

    @property
    def given(self) -> dict[str, tuple[object, ...]]:
        """The options of OPTIONS that were given, with their values."""
        values = {name: getattr(self, name) for name in OPTIONS}
        return {
            name: value if isinstance(value, tuple) else (value,) for name, value in values.items() if value is not None
        }

    def of(self, name: str) -> "Request":
        """What is asked of one experiment: a folder only of those on one."""
        return self if EXPERIMENTS[name].on_folder else replace(self, folder=None)

    def command(self, name: str) -> str:
        """The command line that asks for the same of one experiment; where the folder lies is nobody's business."""
        options = []
        for option, values in self.given.items():
            shown = [f" {value:g}" if option == "sigma2" else "" if value is True else f" {value}" for value in values]
            options += [f"{_flag(option)}{value}" for value in shown]
        folder = ["DIR"] if self.folder is not None else []
        return " ".join(["sonarmap reproduce", name, *folder, *(["--quick"] if self.quick else []), *options])


# The options that not every experiment has, in the order in which a command line shows them
OPTIONS = (
    "scene", "grid", "voxel", "max_tilt", "known", "known_sigmas", "sigma2", "seeds", "pairs", "seed", "method",
    "write",
)  # fmt: skip
_STRUCTURE_OPTIONS = ("scene", "grid", "seeds", "seed")
_REAL_OPTIONS = ("grid", "voxel", "max_tilt", "known", "known_sigmas", "seeds", "seed", "method")
_PAIR_OPTIONS = ("grid", "pairs", "seed", "method")


@dataclass(frozen=True, slots=True)
class ExperimentEntry:
    """One experiment of the table."""

    shows: str  # which of the paper's figures and tables, or what is looked at
    # where its `create` is, or with another name behind a colon; it is imported when the experiment is asked for
    module: str
    options: tuple[str, ...]  # those of OPTIONS that change its rows
    group: str = ALL  # that it belongs to
    timed: bool = False  # whether it measures times, so that its jobs are run one by one
    on_folder: bool = False  # whether it takes a folder of scans


def _entry(shows: str, module: str, options: tuple[str, ...], group: str = ALL, **kind: bool) -> ExperimentEntry:
    return ExperimentEntry(shows, f"sonarmap.tools.lab.reproduce.{module}", options, group, **kind)


_STEPS_OPTIONS = ("scene", "grid", "sigma2", "seeds", "seed", "method")
_MADE_UP = "the mapper's own work on 1,000 to 10,000 scans, with made-up registrations"
# Name on the command line -> experiment, in the order in which a group runs them and its page shows them.
EXPERIMENTS: Mapping[str, ExperimentEntry] = MappingProxyType(
    {
        "translation": _entry("Figs. 12, 14, 15", "structures.moved:create_translation", _STRUCTURE_OPTIONS),
        "rotation": _entry("Figs. 16, 17", "structures.moved:create_rotation", _STRUCTURE_OPTIONS),
        "limits": _entry("Figs. 7 to 9", "structures.limits", _STRUCTURE_OPTIONS),
        "gaussian": _entry("Table 1, Figs. 20, 21", "gaussian.run", _STEPS_OPTIONS[:-1]),
        "floodgate": _entry("Sect. 4, Table 2, Figs. 22 to 31", "floodgate.run", ("grid", "seeds", "seed")),
        "steps": _entry("Table 1, extended to S12, on four scenes", "evaluation.steps", _STEPS_OPTIONS, EVALUATION),
        "pairs": _entry("pairs of every overlap", "evaluation.pair_set:create_pairs", _PAIR_OPTIONS, EVALUATION),
        "unrelated": _entry(
            "pairs that share nothing", "evaluation.pair_set:create_unrelated", _PAIR_OPTIONS, EVALUATION
        ),
        "survey": _entry("maps of whole surveys", "survey.run", _STRUCTURE_OPTIONS, SLAM, timed=True),
        "real": _entry("pairs of real scans in a folder DIR", "real.run", _REAL_OPTIONS, REAL, on_folder=True),
        "scale": _entry(_MADE_UP, "scale.run", ("seeds", "seed"), SCALE, timed=True),
        "kinds": _entry("pairs of every kind of scan", "kinds.run", _PAIR_OPTIONS, KINDS),
        "evidence": _entry("what registrations measure", "evidence.run", _PAIR_OPTIONS[:-1], EVIDENCE),
        "judge": _entry(
            "how far to believe them, fitted to those of a folder DIR",
            "judge.run",
            ("write",),
            FITTING,
            on_folder=True,
        ),
        "decisions": _entry(
            "what the rules of the graph are worth, with registrations that a folder DIR keeps",
            "decisions.run",
            _STRUCTURE_OPTIONS[1:],
            DECIDING,
            on_folder=True,
        ),
    }
)


def entry_of(name: str) -> ExperimentEntry:
    """The experiment of that name."""
    return EXPERIMENTS[name]


def groups() -> tuple[str, ...]:
    """The names of the groups that have an experiment."""
    return tuple(dict.fromkeys(entry.group for entry in EXPERIMENTS.values()))


def members(group: str) -> tuple[str, ...]:
    """The names of a group's experiments, in order."""
    return tuple(name for name, entry in EXPERIMENTS.items() if entry.group == group)


def chosen(name: str, request: Request) -> tuple[str, ...]:
    """The names of the experiments that a name means: itself, or all of a group.

    Raises:
        InputError: there is no such experiment, an option or a folder that was given has no effect on it, or it needs a
            folder and none was given.
    """
    if name not in (*EXPERIMENTS, *groups()):
        raise InputError(f"no experiment is called {name!r}; there are {', '.join((*EXPERIMENTS, *groups()))}")
    names = (name,) if name in EXPERIMENTS else members(name)
    _check_folder(name, names, request.folder)
    options = [option for option in OPTIONS if all(option in EXPERIMENTS[member].options for member in names)]
    idle = [_flag(option) for option in request.given if option not in options]
    if idle:
        known = ", ".join(_flag(option) for option in options)
        verb, pronoun = ("has", "it") if len(idle) == 1 else ("have", "them")
        raise InputError(
            f"{' and '.join(idle)} {verb} no effect on reproduce {name}; leave {pronoun} out"
            + (f". It takes {known}" if known else "")
        )
    return names


def maker(place: str) -> Callable[[Request], "Experiment"]:
    """What makes an experiment: the function `create` of a module, or another one, as in "module:create_pairs"."""
    module, _, name = place.partition(":")
    return getattr(import_module(module), name or "create")


def create(name: str, request: Request) -> "Experiment":
    """The experiment of that name, as it was asked for."""
    return maker(EXPERIMENTS[name].module)(request.of(name))


def _check_folder(name: str, names: tuple[str, ...], folder: Path | None) -> None:
    needed = any(EXPERIMENTS[member].on_folder for member in names)
    if needed and folder is None:
        holds = {
            "decisions": "the registrations that earlier runs made, or nothing yet",
            "judge": "what sonarmap reproduce evidence -o DIR wrote",
            "real": "scans whose names end in a number and a gt.log, or several folders of such",
        }[next(member for member in names if EXPERIMENTS[member].on_folder)]
        raise InputError(f"reproduce {name} needs a folder: sonarmap reproduce {name} DIR; DIR holds {holds}")
    if folder is not None and not needed:
        raise InputError(
            f"reproduce {name} simulates its scans, so the folder {folder} has no effect on it; leave it out, or give "
            "-o before it if the results are to go there"
        )


def _flag(option: str) -> str:
    return f"--{option.replace('_', '-')}"
