"""What was measured of ours beside the other methods, and what follows for a user: the first table of an evaluation."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

from sonarmap.tools.lab.reproduce.experiment import Row
from sonarmap.tools.lab.reproduce.methods import OURS
from sonarmap.tools.lab.reproduce.rows import DASH, distinct, expect, in_percent, rate, where
from sonarmap.tools.lab.reproduce.table import Table

HEADINGS = ("measure", "ours", "others", "what follows")
Line = tuple[str, str, str, str]


@dataclass(frozen=True, slots=True)
class Measure:
    """A share of registrations."""

    words: str  # what is counted
    # of one method's rows the hits, and the rows that they are a share of
    chosen: Callable[[Sequence[Row]], tuple[Sequence[Row], Sequence[Row]]]
    expected: str  # ends the sentence "expect 7 of 100 ..."
    most: bool = True  # whether the largest share is the best, rather than the smallest

    def share(self, rows: Sequence[Row]) -> float | None:
        """Of one method's rows, 0..1; None where there is nothing to take a share of."""
        hits, of = self.chosen(rows)
        return len(hits) / len(of) if of else None

    def line(self, rows: Sequence[Row]) -> Line:
        """Ours, the best and the worst of the others, and what ours lets a user expect."""
        hits, of = self.chosen(where(rows, method=OURS))
        others = others_of(rows, self.share, in_percent, self.most)
        return self.words, rate(hits, of), others, expect(hits, of, self.expected)


def beside_table(lines: Iterable[Line]) -> Table:
    """The table of what was measured."""
    return Table(f"`{OURS}` beside the other methods", HEADINGS, tuple(lines))


def in_short(lines: Iterable[tuple[str, str, str]]) -> Table:
    """The first table where no other method is compared: measure, ours, and what follows."""
    rows = tuple((words, DASH, ours, follows) for words, ours, follows in lines)
    return Table("In short", ("measure", "others", "ours", "what follows"), rows)


def others_of(
    rows: Sequence[Row],
    value: Callable[[Sequence[Row]], float | None],
    form: Callable[[float], str],
    most: bool = False,
) -> str:
    """The best and the worst of the other methods, as in "best: kiss 93 %; worst: icp 41 %"; `most`: the largest is the
    best. `value` is of one method's rows, None where there is none, and `form` shows it."""
    values = {name: value(where(rows, method=name)) for name in distinct(rows, "method") if name != OURS}
    known = {name: number for name, number in values.items() if number is not None}
    order = sorted(known, key=lambda name: known[name], reverse=most)
    if not order:
        return DASH
    worst = f"; worst: {order[-1]} {form(known[order[-1]])}" if len(order) > 1 else ""
    return f"best: {order[0]} {form(known[order[0]])}{worst}"
