"""What an experiment is: jobs that can be done one by one, and what is made of all their rows."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar, Protocol, runtime_checkable

from sonarmap.tools.lab.reproduce.table import Table

Value = str | int | float | bool
Row = Mapping[str, Value]


@dataclass(frozen=True, slots=True)
class Outcome:
    """The results of one job.

    Attributes:
        rows: the same on every run, key by key: they become NAME.csv.
        seconds: rows of times: they become NAME-seconds.csv, the file that may differ between runs.
    """

    rows: tuple[Row, ...]
    seconds: tuple[Row, ...] = ()


@dataclass(frozen=True, slots=True)
class Section:
    """The text, tables and pictures of an experiment, for its page.

    Attributes:
        title: a heading, with the paper's figures and tables in it.
        introduction: Markdown: what was done, what counts as right.
        tables: the first has the paper's (or the required) values, ours, and the verdicts side by side.
        times: tables of run times; they differ between runs and stand in a file of their own.
        pictures: file names of the figures -> captions, in order; `draw` writes them.
        remarks: Markdown: what the figures show, computed from the rows.
    """

    title: str
    introduction: str
    tables: tuple[Table, ...]
    times: tuple[Table, ...]
    pictures: Mapping[str, str]
    remarks: str = ""


class Experiment(Protocol):
    """An experiment, with its settings. A new one is a class and a row of EXPERIMENTS.

    Jobs whose keys differ in the last part alone, as 3/a and 3/b, may share work: they are done by one process.
    """

    name: ClassVar[str]
    sources: ClassVar[tuple[str, ...]]  # folders and files whose code decides rows, with the experiment's own
    settings: Any  # a frozen dataclass of JSON's types: with the sources it decides all rows

    def jobs(self) -> Sequence[str]:
        """The keys of all jobs, in the order in which they are done; each can be done alone."""
        ...

    def run(self, job: str) -> Outcome:
        """Do one job. What jobs share (plans, prepared scans) is kept by the experiment, and may be made anew."""
        ...

    def section(self, outcomes: Mapping[str, Outcome]) -> Section:
        """The words and tables, from all jobs' outcomes."""
        ...

    def draw(self, folder: Path, outcomes: Mapping[str, Outcome]) -> None:
        """Write the section's pictures into an existing folder."""
        ...


@runtime_checkable
class ByMethod(Experiment, Protocol):
    """An experiment whose jobs are of one method each, which the last part of a job's key names.

    The jobs of each method are kept for themselves: when the code of one changes, those of the others stay done.
    """

    methods: tuple[str, ...]  # keys of METHODS
    deciding: Mapping[str, Any]  # with a job's key, the code and the device all that decides its rows
