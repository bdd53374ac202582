"""What is right, believed, and wrong and believed: of ours against what is required, and of every method."""

from collections.abc import Sequence

from tools.reproduce.evaluation.methods import OURS
from tools.reproduce.evaluation.summary import accepted, percent, right, wrong
from tools.reproduce.experiment import Row
from tools.reproduce.kinds.kind_summary import (
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
from tools.reproduce.kinds.settings import LEVELED, NOTHING
from tools.reproduce.rows import where
from tools.reproduce.table import Table, verdict
from tools.simulate.kinds.kind import RELIEFS

RIGHT = {LEVELED: 0.9, NOTHING: 0.8}  # least share of the pairs of a kind, by what is known
BELIEVED = 0.85  # least share of the right
FALSE = 0.01  # greatest share of all pairs of a kind that is wrong and believed

Line = tuple[str, str, str, str]


def requirements(rows: Sequence[Row]) -> list[Line]:
    """What each kind has to reach, as measure, required, ours, verdict: how many kinds do, and the worst of them."""
    lines: list[Line] = []
    for known, least in RIGHT.items():
        ours = where(rows, method=OURS, priors=known)
        measures = (
            ("right", f"at least {_percent(least)}", lambda some: _share(right(tried(some)), tried(some)), least),
            (
                "believed, of the right",
                f"at least {_percent(BELIEVED)}",
                lambda some: _share(accepted(right(tried(some))), right(tried(some))),
                BELIEVED,
            ),
            (
                "wrong and believed",
                f"at most {_percent(FALSE)}",
                lambda some: -_share(accepted(wrong(some)), some, 0.0),
                -FALSE,
            ),
        )
        for measure, required, score, bound in measures if ours else ():
            scores = {kind: score(where(ours, kind=kind)) for kind in distinct(ours, "kind")}
            worst = min(scores, key=lambda kind: scores[kind])
            good = sum(value >= bound for value in scores.values())
            shown = f"{good} of {len(scores)} kinds; worst: {worst} {_percent(abs(scores[worst]))}"
            what = f"{measure}, in each kind, known: {WORDS[known]}"
            lines.append((what, f"{required} of each kind", shown, verdict(good == len(scores))))
    return lines


def kind_table(rows: Sequence[Row]) -> Table:
    """Ours by kind, the worst first, against what is required."""
    lines = []
    for kind in worst_first(rows):
        for known, least in RIGHT.items():
            some = where(rows, method=OURS, kind=kind, priors=known)
            if not some:
                continue
            firm = tried(some)
            good, false = right(firm), accepted(wrong(some))
            holds = (
                _share(good, firm) >= least
                and _share(accepted(good), good) >= BELIEVED
                and len(false) <= FALSE * len(some)
            )
            cells = (percent(good, firm), percent(accepted(good), good), percent(false, some), verdict(holds))
            lines.append((kind, WORDS[known], str(len(firm)), *cells))
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


def _share(hits: Sequence[Row], rows: Sequence[Row], empty: float = 1.0) -> float:
    return len(hits) / len(rows) if rows else empty


def _percent(share: float) -> str:
    return f"{100 * share:.0f} %"
