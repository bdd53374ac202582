"""The experiments that `sonarmap reproduce` knows, and what its options ask of them.

To add one: write a module with a class that is an `Experiment` (tools/reproduce/experiment.py) and a function

    def create(request: Request) -> Experiment:

that makes it from the options (None: the option was not given, so the experiment's own value holds), and add a row to
EXPERIMENTS. Modules of tools/reproduce whose names end with a word of `provenance.SHOWING`, as in rotation_figure.py,
only show rows: changing them does not make jobs run again; changing any other module that the experiment imports does.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from importlib import import_module
from types import MappingProxyType
from typing import TYPE_CHECKING

from kernels.errors import InputError

if TYPE_CHECKING:
    from kernels.device import Device
    from tools.reproduce.experiment import Experiment

ALL = "all"


@dataclass(frozen=True, slots=True)
class Request:
    """What the command line asks for.

    Attributes:
        device: to run on; None where only the options are looked at.
        quick: a minute at most, with less of everything that no option sets.
        seeds, seed: how many, and the first of them.
        grid: voxels per edge.
        scene: a key of SCENES.
        sigma2: variances of the range noise at the largest range [m^2].
    """

    device: "Device | None" = None
    quick: bool = False
    seeds: int | None = None
    seed: int | None = None
    grid: int | None = None
    scene: str | None = None
    sigma2: tuple[float, ...] | None = None

    @property
    def opened(self) -> "Device":
        """The device, which is there once an experiment is made."""
        if self.device is None:
            raise ValueError("no device was chosen")
        return self.device

    @property
    def given(self) -> dict[str, tuple[object, ...]]:
        """The options that were given, without those that every experiment hears, with their values."""
        values = {name: getattr(self, name) for name in OPTIONS}
        return {name: _as_tuple(value) for name, value in values.items() if value is not None}

    def command(self, name: str) -> str:
        """The command line that asks for the same of one experiment."""
        options = [f"--{option} {value}" for option, values in self.given.items() for value in values]
        return " ".join(["sonarmap reproduce", name, *(["--quick"] if self.quick else []), *options])


# The options that an experiment may hear, in the order in which they are told.
OPTIONS = ("scene", "grid", "sigma2", "seeds", "seed")
_STRUCTURE_OPTIONS = ("scene", "grid", "seeds", "seed")


@dataclass(frozen=True, slots=True)
class Entry:
    """One experiment of the table.

    Attributes:
        shows: which of the paper's figures and tables.
        module: where its `create` is; it is imported when the experiment is asked for.
        hears: those of OPTIONS that mean something to it.
    """

    shows: str
    module: str
    hears: tuple[str, ...]


# Name on the command line -> experiment, in the order in which `all` runs them and the page shows them.
EXPERIMENTS: Mapping[str, Entry] = MappingProxyType(
    {
        "translation": Entry("Figs. 12, 14, 15", "tools.reproduce.translation", _STRUCTURE_OPTIONS),
        "rotation": Entry("Figs. 16, 17", "tools.reproduce.rotation", _STRUCTURE_OPTIONS),
        "limits": Entry("Figs. 7 to 9", "tools.reproduce.limits", _STRUCTURE_OPTIONS),
        "gaussian": Entry("Table 1, Figs. 20, 21", "tools.reproduce.gaussian", OPTIONS),
        "floodgate": Entry("Sect. 4, Table 2, Figs. 22 to 31", "tools.reproduce.floodgate", ("grid", "seeds", "seed")),
    }
)


def chosen(name: str, request: Request) -> tuple[str, ...]:
    """The names of the experiments that are meant: one, or with `all` every one.

    Raises:
        InputError: there is no such experiment, or it does not hear an option that was given.
    """
    if name != ALL and name not in EXPERIMENTS:
        raise InputError(f"no experiment is called {name!r}; there are {', '.join((*EXPERIMENTS, ALL))}")
    names = tuple(EXPERIMENTS) if name == ALL else (name,)
    hears = [option for option in OPTIONS if all(option in EXPERIMENTS[one].hears for one in names)]
    deaf = [f"--{option}" for option in request.given if option not in hears]
    if deaf:
        known = ", ".join(f"--{option}" for option in hears)
        raise InputError(
            f"reproduce {name} has no use for {' and '.join(deaf)}; "
            + (f"it takes {known}" if known else "leave it out")
        )
    return names


def create(name: str, request: Request) -> "Experiment":
    """The experiment of that name, as it was asked for.

    Raises:
        InputError: an option's value will not do.
    """
    return import_module(EXPERIMENTS[name].module).create(request)


def _as_tuple(value: object) -> tuple[object, ...]:
    return tuple(f"{one:g}" for one in value) if isinstance(value, tuple) else (value,)
