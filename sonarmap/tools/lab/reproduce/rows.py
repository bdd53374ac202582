"""Rows of an experiment: all of them, and those that hold certain values."""

from collections.abc import Iterable, Mapping

from sonarmap.tools.lab.reproduce.experiment import Outcome, Row


def all_rows(outcomes: Mapping[str, Outcome]) -> list[Row]:
    """The rows of all jobs, in order."""
    return [row for outcome in outcomes.values() for row in outcome.rows]


def all_seconds(outcomes: Mapping[str, Outcome]) -> list[Row]:
    """The rows of times of all jobs, in order."""
    return [row for outcome in outcomes.values() for row in outcome.seconds]


def where(rows: Iterable[Row], **values: object) -> list[Row]:
    """The rows that hold these values."""
    return [row for row in rows if all(row[name] == value for name, value in values.items())]
