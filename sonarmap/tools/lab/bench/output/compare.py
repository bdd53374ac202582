"""An earlier run's result, and what became slower or faster since, beyond the noise of both."""

import json
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from sonarmap.kernels.errors import InputError
from sonarmap.tools.files.user_file import read_content
from sonarmap.tools.lab.bench.timing import Times

# A difference of medians below this share is none, even where the quartiles do not overlap.
MARGIN = 0.1


def read_result(path: Path) -> dict[str, Any]:
    """What an earlier run wrote.

    Raises:
        InputError: the file cannot be read, or is none of `sonarmap bench`.
    """
    with results_of(path):
        content = json.loads(read_content(path, pipe=True))
        compare(content, content)  # looks at all that another run is compared with
        return content


@contextmanager
def results_of(path: Path | None) -> Iterator[None]:
    """Whatever the block misses in a result refuses the file that it was read from; None: it was measured just now.

    Raises:
        InputError: the file is none of `sonarmap bench`.
    """
    try:
        yield
    except InputError:
        raise
    except (ArithmeticError, AttributeError, LookupError, TypeError, ValueError, RecursionError) as error:
        if path is None:
            raise
        raise InputError(f"{path} is not a result of `sonarmap bench`; give a file that -o or --json wrote") from error


@dataclass(frozen=True, slots=True)
class Change:
    """One figure that differs."""

    what: str  # which, in words
    # old, new: its values, with their unit
    old: str
    new: str
    worse: bool  # whether it is a regression

    def __str__(self) -> str:
        return f"{self.what}: {self.old} -> {self.new}"


@dataclass(frozen=True, slots=True)
class Comparison:
    """Two runs side by side."""

    changes: tuple[Change, ...]  # what differs beyond the noise, the worse first
    compared: int  # how many figures both runs have
    notes: tuple[str, ...]  # what makes the runs hard to compare

    @property
    def regressions(self) -> tuple[Change, ...]:
        """The worse ones."""
        return tuple(change for change in self.changes if change.worse)


def compare(old: Mapping[str, Any], new: Mapping[str, Any]) -> Comparison:
    """Compare two results; older ones may lack keys.

    A time differs where the quartiles do not overlap and the medians are more than MARGIN apart. Counts of launches and
    of blocking reads have no noise.
    """
    changes: list[Change] = []
    times, counts = dict(_times(old)), dict(_counts(old))
    compared = 0
    for what, now in _times(new):
        if what in times:
            compared += 1
            changes += _time_change(what, times[what], now)
    for what, now in _counts(new):
        if what in counts:
            compared += 1
            before = counts[what]
            if abs(now - before) > MARGIN * max(before, 1.0):
                changes.append(Change(what, f"{before:g}", f"{now:g}", now > before))
    changes += _outcome_changes(old, new)
    return Comparison(tuple(sorted(changes, key=lambda change: not change.worse)), compared, tuple(_notes(old, new)))


def _times(result: Mapping[str, Any]) -> Iterator[tuple[str, Mapping[str, float]]]:
    for row in result["kernels"]:
        if row["right"]:
            yield f"{row['kernel']} at {row['grid']}^3", row["device_seconds"]
    for row in result["pairs"]:
        yield f"prepare a scan at {row['grid']}^3", row["prepare_seconds"]
        yield f"register a pair at {row['grid']}^3", row["register_seconds"]


def _counts(result: Mapping[str, Any]) -> Iterator[tuple[str, float]]:
    for row in result["pairs"]:
        stages = row.get("stages") or []
        for name, words in (("launches", "launches of a pair"), ("reads", "blocking reads of a pair")):
            if stages:
                yield f"{words} at {row['grid']}^3", sum(stage[name] for stage in stages)
        if row.get("device_memory"):
            yield f"device memory at {row['grid']}^3 [MiB]", round(row["device_memory"] / 2**20)


def _time_change(what: str, old: Mapping[str, float], new: Mapping[str, float]) -> list[Change]:
    before, now = (_as_times(times) for times in (old, new))
    slower = now.first_quartile > before.third_quartile and now.median > (1 + MARGIN) * before.median
    faster = now.third_quartile < before.first_quartile and before.median > (1 + MARGIN) * now.median
    if not (slower or faster):
        return []
    ratio = now.median / before.median if slower else before.median / now.median
    words = f"{1e3 * now.median:.3g} ms, {ratio:.2f} times as {'long' if slower else 'fast'}"
    return [Change(what, f"{1e3 * before.median:.3g} ms", words, slower)]


def _as_times(times: Mapping[str, float]) -> Times:
    names = ("median", "first_quartile", "third_quartile", "least", "most")
    return Times(int(times["count"]), *(float(times[name]) for name in names))


def _outcome_changes(old: Mapping[str, Any], new: Mapping[str, Any]) -> Iterator[Change]:
    before = {row["grid"]: row for row in old["pairs"]}
    for row in new["pairs"]:
        earlier = before.get(row["grid"])
        if earlier and earlier["register_seconds"]["count"] == row["register_seconds"]["count"]:
            for name in ("right", "accepted"):
                if row[name] != earlier[name]:
                    what = f"pairs {name} at {row['grid']}^3"
                    yield Change(what, str(earlier[name]), str(row[name]), row[name] < earlier[name])


def _notes(old: Mapping[str, Any], new: Mapping[str, Any]) -> Iterator[str]:
    for name in ("device", "processor", "cores", "seed"):
        if old.get(name) != new.get(name):
            yield f"the runs differ in their {name}: {_words(old.get(name))} and {_words(new.get(name))}"
    rates = old["copy_rate"], new["copy_rate"]
    if max(rates) > 1.25 * min(rates):
        yield (
            f"the device copied {rates[0] / 1e9:.1f} GB/s then and {rates[1] / 1e9:.1f} GB/s now: other work on the "
            "machine may be the reason for what differs"
        )


def _words(value: Any) -> str:
    return ", ".join(map(str, value.values())) if isinstance(value, Mapping) else str(value)
