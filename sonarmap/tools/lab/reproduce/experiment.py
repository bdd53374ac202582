"""What an experiment is: jobs that can be run one by one, each with rows of numbers."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from types import SimpleNamespace

from sonarmap.spectral.grid import Grid

Value = str | int | float | bool
Row = Mapping[str, Value]
Settings = SimpleNamespace  # values of JSON's types by name; with the sources they decide all rows

EXTENT = 256.0  # of the paper's grid [m]


@dataclass(frozen=True, slots=True)
class Outcome:
    """The results of one job."""

    rows: tuple[Row, ...]  # the same on every run, key by key: they become NAME.csv
    seconds: tuple[Row, ...] = ()  # rows of times: they become NAME-seconds.csv, the file that may differ between runs


@dataclass(frozen=True, slots=True)
class Experiment:
    """An experiment as it was asked for. What it shows of its rows is in `tables.py` and `figures.py`."""

    name: str  # on the command line, and of its files
    settings: Settings
    # The keys of all jobs, in the order in which they are done. Jobs whose keys differ in the last part alone, as 3/a
    # and 3/b, may share work: they are done by one process.
    jobs: Sequence[str]
    run: Callable[[str], Outcome]  # does one job, whichever were done before
    sources: tuple[str, ...]  # folders and files whose code decides rows, its own module among them
    # Methods that the last part of each job's key names; "" for none. The jobs of each are kept for themselves: when
    # the code of one method changes, those of the others stay done.
    methods: tuple[str, ...] = ()
    deciding: tuple[str, ...] = ("edge", "seed")  # settings that decide a method's rows, with the key, code and device
    conclude: Callable[[Sequence[Row]], Sequence[Row]] | None = None  # makes of all rows those that tables show
    write: Callable[[Sequence[Row]], str] | None = None  # stores what was fitted to the rows, and says where


def all_seeds(settings: Settings) -> range:
    """As many as are asked for, from the first."""
    return range(settings.first_seed, settings.first_seed + settings.seeds)


def paper_grid(edge: int) -> Grid:
    """A grid of `edge` voxels along each edge, as large as the paper's, which has 256 voxels of about 1 m."""
    Grid(edge, 1.0)  # its error names the edge alone
    return Grid(edge, EXTENT / edge)
