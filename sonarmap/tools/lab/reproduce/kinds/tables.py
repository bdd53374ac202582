"""What is right, believed, and wrong and believed: of ours against what is required, and of every method."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from sonarmap.tools.lab.reproduce.evaluation.methods import OURS
from sonarmap.tools.lab.reproduce.evaluation.summary import accepted, percent, right, wrong
from sonarmap.tools.lab.reproduce.experiment import Row
from sonarmap.tools.lab.reproduce.kinds.kind_summary import (
    FLAT,
    WORDS,
    distinct,
    outcome,
    tried,
    variant_words,
    variants,
    without_navigation,
    worst_first,
)
from sonarmap.tools.lab.reproduce.kinds.settings import LEVELED, NOTHING
from sonarmap.tools.lab.reproduce.rows import where
from sonarmap.tools.lab.reproduce.table import Table, verdict
from sonarmap.tools.lab.simulate.kinds.kind import RELIEFS

RIGHT = {LEVELED: 0.9, NOTHING: 0.8}  # least share of the pairs of a kind, by what is known
BELIEVED = 0.85  # least share of the right
FALSE = 0.01  # greatest share of all pairs of a kind that is wrong and believed

Line = tuple[str, str, str, str]


@dataclass(frozen=True, slots=True)
class Requirement:
    """A share of registrations that every kind has to reach, or not to exceed.

    Attributes:
        measure: in words.
        chosen: of rows of one kind the hits, and the rows that they are a share of.
        bound: of the share.
        is_most: whether the share may not exceed the bound, rather than reach it.
    """

    measure: str
    chosen: Callable[[Sequence[Row]], tuple[Sequence[Row], Sequence[Row]]]
    bound: float
    is_most: bool = False

    @property
    def words(self) -> str:
        """As a table says it."""
        return f"{'at most' if self.is_most else 'at least'} {100 * self.bound:.0f} % of each kind"

    def margin(self, rows: Sequence[Row]) -> float:
        """How far the share of one kind's rows is on the good side; inf where there is nothing to take a share of."""
        hits, of = self.chosen(rows)
        if not of:
            return math.inf
        margin = len(hits) / len(of) - self.bound
        return -margin if self.is_most else margin


def requirements_with(known: str) -> tuple[Requirement, ...]:
    """What is required with this knowledge, a key of RIGHT; only what is wrong and believed is a share of all pairs."""
    return (
        Requirement("right", lambda rows: (right(tried(rows)), tried(rows)), RIGHT[known]),
        Requirement(
            "believed, of the right", lambda rows: (accepted(right(tried(rows))), right(tried(rows))), BELIEVED
        ),
        Requirement("wrong and believed", lambda rows: (accepted(wrong(rows)), rows), FALSE, is_most=True),
    )


def requirements(rows: Sequence[Row]) -> list[Line]:
    """What each kind has to reach, as measure, required, ours, verdict: how many kinds do, and the worst of them."""
    lines: list[Line] = []
    for known in RIGHT:
        ours = where(rows, method=OURS, priors=known)
        kinds = {kind: where(ours, kind=kind) for kind in distinct(ours, "kind")}
        for requirement in requirements_with(known):
            margins = {kind: requirement.margin(some) for kind, some in kinds.items()}
            margins = {kind: margin for kind, margin in margins.items() if margin < math.inf}
            if not margins:
                continue
            worst = min(margins, key=lambda kind: margins[kind])
            good = sum(margin >= 0 for margin in margins.values())
            shown = f"{good} of {len(margins)} kinds; worst: {worst} {percent(*requirement.chosen(kinds[worst]))}"
            what = f"{requirement.measure}, known: {WORDS[known]}"
            lines.append((what, requirement.words, shown, verdict(good == len(margins))))
    return lines


def kind_table(rows: Sequence[Row]) -> Table:
    """Ours by kind, the worst first, against what is required."""
    lines = []
    for kind in worst_first(rows):
        for known in RIGHT:
            some = where(rows, method=OURS, kind=kind, priors=known)
            required = requirements_with(known)
            if some:
                shares = (percent(*requirement.chosen(some)) for requirement in required)
                holds = all(requirement.margin(some) >= 0 for requirement in required)
                lines.append((kind, WORDS[known], str(len(tried(some))), *shares, verdict(holds)))
    headings = ("kind", "known", "pairs", "right", "believed, of the right", "wrong and believed, of all", "verdict")
    title = f"`{OURS}` by kind, the worst first (the flat scenes count in the last share alone)"
    return Table(title, headings, tuple(lines))


def method_table(rows: Sequence[Row]) -> Table:
    """Every method by kind, the worst first."""
    kinds = worst_first(rows)
    groups = [(kind, where(rows, kind=kind)) for kind in kinds]
    groups += [("all kinds", list(rows))] if len(kinds) > 1 else []
    title = "Every method by kind: share right, share believed of the right, number wrong and believed; no flat scenes"
    return _by_method(title, "kind", [(name, tried(some)) for name, some in groups], variants(rows))


def relief_table(rows: Sequence[Row]) -> Table:
    """Every method by what the scene gives to hold on to; the flat ones stand apart from all requirements."""
    groups = [(f"{name} (no requirement)" if name == FLAT else name, where(rows, relief=name)) for name in RELIEFS]
    title = "Every method by relief: share right, share believed of the right, number wrong and believed"
    return _by_method(title, "relief", [(name, some) for name, some in groups if some], variants(rows))


def _by_method(
    title: str, heading: str, groups: Sequence[tuple[str, Sequence[Row]]], columns: Sequence[tuple[str, str]]
) -> Table:
    lines = []
    for name, rows in groups:
        some = without_navigation(rows)
        pairs = len({(row["kind"], row["number"]) for row in some})
        cells = (outcome(where(some, method=method, priors=known)) for method, known in columns)
        lines.append((name, str(pairs), *cells))
    return Table(title, (heading, "pairs", *(variant_words(*column) for column in columns)), tuple(lines))
