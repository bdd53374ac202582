"""What an experiment is: jobs that can be done one by one, and what is made of all their rows."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import Any, ClassVar

from sonarmap.tools.lab.reproduce.table import Table

Value = str | int | float | bool
Row = Mapping[str, Value]


@dataclass(frozen=True, slots=True)
class Outcome:
    """The results of one job."""

    rows: tuple[Row, ...]  # the same on every run, key by key: they become NAME.csv
    seconds: tuple[Row, ...] = ()  # rows of times: they become NAME-seconds.csv, the file that may differ between runs


@dataclass(frozen=True, slots=True)
class Section:
    """The tables and pictures of an experiment, for its page."""

    title: str  # a heading, with the paper's figures and tables in it
    tables: tuple[Table, ...]  # the first has the paper's values, or the other methods', beside ours, and what follows
    times: tuple[Table, ...] = ()  # tables of run times; they differ between runs and stand in a file of their own
    # file names of the figures -> captions, in order
    pictures: Mapping[str, str] = field(default_factory=dict)


class Experiment(ABC):
    """An experiment, with its settings. A new one is a class and a row of EXPERIMENTS.

    Jobs whose keys differ in the last part alone, as 3/a and 3/b, may share work: they are done by one process.

    Attributes:
        name: on the command line, and of its files.
        sources: folders and files whose code decides rows, with the file of the experiment's own class.
        make_section: the words and tables, from the rows and times of all jobs and the settings.
        draw_pictures: writes the section's pictures into an existing folder, from the rows and the settings.
        settings: a frozen dataclass of JSON's types: with the sources it decides all rows.
        device: to run jobs on, as the experiment needs it: a Device, or the text that `choose_device` takes.
    """

    name: ClassVar[str]
    sources: ClassVar[tuple[str, ...]]
    make_section: ClassVar[Callable[[Sequence[Row], Sequence[Row], Any], Section]]
    draw_pictures: ClassVar[Callable[[Path, Sequence[Row], Any], None]] = staticmethod(lambda *_: None)

    def __init__(self, settings: Any, device: Any = None) -> None:
        """Nothing is planned on the device before a job is run."""
        self.settings, self.device = settings, device

    @abstractmethod
    def jobs(self) -> Sequence[str]:
        """The keys of all jobs, in the order in which they are done; each can be done alone."""

    @abstractmethod
    def run(self, job: str) -> Outcome:
        """Do one job. What jobs share (plans, prepared scans) is kept by the experiment, and may be made anew."""

    def section(self, rows: Sequence[Row], seconds: Sequence[Row]) -> Section:
        """The words and tables."""
        return type(self).make_section(rows, seconds, self.settings)

    def write(self, rows: Sequence[Row]) -> str:
        """Write what was fitted where the package reads it, and say so; most experiments fit nothing."""
        raise NotImplementedError

    def draw(self, folder: Path, rows: Sequence[Row]) -> None:
        """Write the section's pictures; none of them shows times."""
        type(self).draw_pictures(folder, rows, self.settings)


def in_turns(counts: Mapping[str, int]) -> list[str]:
    """Jobs of sets of so many draws each, as in swath-0003; the sets in turns, so that a run that is stopped has some
    of each."""
    numbered = [(number / count, f"{name}-{number:04d}") for name, count in counts.items() for number in range(count)]
    return [job for _, job in sorted(numbered)]


class ByMethod(Experiment):
    """An experiment whose jobs are of one method each, which the last part of a job's key names.

    The jobs of each method are kept for themselves: when the code of one changes, those of the others stay done.

    Attributes:
        make_scans: makes what all methods register, from the parts of a job's key that say which scans these are.
        scans: the same; what it made last is kept for the next method.
    """

    make_scans: ClassVar[Callable[..., Any]]
    # names of the settings that decide a job's rows, with its key, the code and the device
    deciding: ClassVar[tuple[str, ...]] = ("edge", "seed")

    def __init__(self, settings: Any, device: str | None = None) -> None:
        """`device` as `choose_device` takes it."""
        super().__init__(settings, device)
        self.scans = lru_cache(maxsize=1)(self.make_scans)

    @property
    def methods(self) -> tuple[str, ...]:
        """Keys of METHODS."""
        return self.settings.compared.methods
