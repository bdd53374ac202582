"""What is right and believed, kind by kind, by every method; and what registration adds to navigation."""

import math
from collections.abc import Callable, Iterable, Sequence
from statistics import median

import numpy as np

from sonarmap.tools.lab.reproduce.beside import Line, Measure
from sonarmap.tools.lab.reproduce.experiment import Row
from sonarmap.tools.lab.reproduce.kinds.navigation import FIXED, Direction, directions
from sonarmap.tools.lab.reproduce.kinds.settings import LEVELED, NAVIGATION, NOTHING
from sonarmap.tools.lab.reproduce.methods import OURS
from sonarmap.tools.lab.reproduce.rows import (
    DASH,
    Rate,
    accepted,
    distinct,
    grouped,
    in_percent,
    number,
    percent,
    right,
    variants,
    where,
    wilson,
    wrong,
)
from sonarmap.tools.lab.reproduce.table import Table, table_of
from sonarmap.tools.lab.simulate.kinds.kind import RELIEFS

FLAT = "flat"  # the relief of scenes that cannot fix a pose
WORDS = {NOTHING: "nothing", LEVELED: "attitude, depth", NAVIGATION: "navigation"}  # as columns show what is known


def tried(rows: Iterable[Row]) -> list[Row]:
    """Those whose scene can fix a pose."""
    return [row for row in rows if row["relief"] != FLAT]


def without_navigation(rows: Iterable[Row]) -> list[Row]:
    """Those of the pairs that every kind has."""
    return [row for row in rows if row["priors"] != NAVIGATION]


def worst_first(rows: Sequence[Row]) -> list[str]:
    """The kinds, from the one with the least share right; of ours, or of all methods where ours did not run."""
    some = without_navigation(tried(rows))
    ours = where(some, method=OURS) or some

    def share(kind: str) -> float:
        of_kind = where(ours, kind=kind)
        return len(right(of_kind)) / max(len(of_kind), 1)

    return sorted(distinct(rows, "kind"), key=share)


def every_variant(rows: Sequence[Row]) -> list[tuple[str, str]]:
    """Every method with everything that it was given, but navigation; those of one method together."""
    return variants(without_navigation(rows), "priors")


def variant_words(method: str, known: str) -> str:
    """For a heading."""
    return method if known == NOTHING else f"{method}, known: {WORDS[known]}"


def outcome(rows: Sequence[Row]) -> str:
    """Right, believed of the right, and wrong and believed, as in "93 %, 88 %, 1"; of no rows a dash."""
    if not rows:
        return DASH
    good = right(rows)
    believed = in_percent(len(accepted(good)) / len(good)) if good else DASH
    return f"{in_percent(len(good) / len(rows))}, {believed}, {len(accepted(wrong(rows)))}"


def measures_with(known: str) -> tuple[Measure, ...]:
    """What is counted with this knowledge; only what is wrong and believed is a share of all pairs."""
    words = f"known: {WORDS[known]}"
    return (
        Measure(f"right, {words}", lambda rows: (right(tried(rows)), tried(rows)), "to be right"),
        Measure(
            f"believed, of the right, {words}",
            lambda rows: (accepted(right(tried(rows))), right(tried(rows))),
            "right registrations to be believed",
        ),
        Measure(
            f"wrong and believed, {words}",
            lambda rows: (accepted(wrong(rows)), rows),
            "pairs to be wrong and believed",
            most=False,
        ),
    )


def beside_others(rows: Sequence[Row]) -> list[Line]:
    """Ours with what is known, in all and in its worst kind, beside the others with nothing but the points."""
    others = [row for row in where(rows, priors=NOTHING) if row["method"] != OURS]
    lines: list[Line] = []
    for known in (LEVELED, NOTHING):
        ours = where(rows, method=OURS, priors=known)
        for measure in measures_with(known):
            kinds = {kind: measure.share(where(ours, kind=kind)) for kind in distinct(ours, "kind")}
            shares = {kind: share for kind, share in kinds.items() if share is not None}
            if shares:
                worst = (min if measure.most else max)(shares, key=lambda kind: shares[kind])
                what, shown, beside, follows = measure.line([*ours, *others])
                worst_share = percent(*measure.chosen(where(ours, kind=worst)))
                lines.append((what, f"{shown}; worst kind: {worst} {worst_share}", beside, follows))
    return lines


def kind_table(rows: Sequence[Row]) -> Table:
    """Ours by kind, the worst first."""
    groups = [
        ((kind, WORDS[known]), where(rows, method=OURS, kind=kind, priors=known))
        for kind in worst_first(rows)
        for known in (LEVELED, NOTHING)
    ]
    columns: dict[str, Callable[[Sequence[Row]], str]] = {"pairs": lambda some: str(len(tried(some)))}
    names = ("right", "believed, of the right", "wrong and believed, of all")
    for name, measure in zip(names, measures_with(NOTHING), strict=True):
        columns[name] = lambda some, chosen=measure.chosen: percent(*chosen(some))
    title = f"`{OURS}` by kind, the worst first (the flat scenes count in the last share alone)"
    return table_of(title, ("kind", "known"), [group for group in groups if group[1]], columns)


def method_table(rows: Sequence[Row]) -> Table:
    """Every method by kind, the worst first."""
    kinds = worst_first(rows)
    groups = [(kind, where(tried(rows), kind=kind)) for kind in kinds]
    groups += [("all kinds", tried(rows))] if len(kinds) > 1 else []
    title = "Every method by kind: share right, share believed of the right, number wrong and believed; no flat scenes"
    return _by_method(title, "kind", groups, every_variant(rows))


def relief_table(rows: Sequence[Row]) -> Table:
    """Every method by what the scene gives to hold on to; the flat ones stand apart."""
    groups = [(f"{name} (cannot fix a pose)" if name == FLAT else name, where(rows, relief=name)) for name in RELIEFS]
    title = "Every method by relief: share right, share believed of the right, number wrong and believed"
    return _by_method(title, "relief", [(name, some) for name, some in groups if some], every_variant(rows))


def _by_method(
    title: str, heading: str, groups: Sequence[tuple[str, Sequence[Row]]], variants: Sequence[tuple[str, str]]
) -> Table:
    columns: dict[str, Callable[[Sequence[Row]], str]] = {
        "pairs": lambda some: str(len(grouped(some, "kind", "number")))
    }
    for method, known in variants:
        columns[variant_words(method, known)] = lambda some, method=method, known=known: outcome(
            where(some, method=method, priors=known)
        )
    return table_of(title, (heading,), [((name,), without_navigation(some)) for name, some in groups], columns)


WITHIN = 2.0  # standard deviations


def navigation_beside(rows: Sequence[Row]) -> list[Line]:
    """Along the directions that the covariance calls fixed, beside navigation alone."""
    rows = tried(where(rows, method=OURS, priors=NAVIGATION))
    fixed, _ = _fixed_and_others(rows)
    words = "swaths with navigation, directions that the covariance calls fixed"
    if not fixed:
        return [(words, f"none in {len(rows)} pairs", DASH, "registration adds nothing to navigation")] if rows else []
    ours, navigation = _median(fixed, "error"), _median(fixed, "navigation_error")
    covered = _covered(fixed)
    return [
        (
            f"{words}: median error",
            f"{ours:.2f} m",
            f"navigation alone: {navigation:.2f} m",
            f"registration leaves {in_percent(ours / navigation)} of navigation's error",
        ),
        (
            f"{words}: errors within {WITHIN:g} standard deviations",
            str(covered),
            DASH,
            f"expect {100 * covered.share:.0f} of 100 errors within them (95 where the covariance is exact)",
        ),
    ]


def navigation_table(rows: Sequence[Row]) -> Table:
    """By relief: errors of navigation alone and of the registration, both along its covariance's directions."""
    ours = where(rows, method=OURS, priors=NAVIGATION)
    groups = [(str(relief), where(ours, relief=relief)) for relief in RELIEFS]
    groups += [("all but flat", tried(ours)), ("all but flat, believed", accepted(tried(ours)))]
    headings = (
        "relief",
        "pairs",
        "directions fixed, of 3",
        "along them: median error of navigation [m]",
        "of the registration [m]",
        "pairs whose error is below a third of navigation's",
        f"errors within {WITHIN:g} standard deviations",
        "along the others: median error of navigation [m]",
        "of the registration [m]",
    )
    title = f"Swaths with navigation: errors along the directions that the covariance of `{OURS}` calls fixed"
    return Table(title, headings, tuple(_line(name, some) for name, some in groups if some))


def _line(name: str, rows: Sequence[Row]) -> tuple[str, ...]:
    with_directions = sum(bool(directions(row)) for row in rows)
    fixed, others = _fixed_and_others(rows)
    nearer = [_is_below_a_third(some) for row in rows if (some := _fixed_and_others([row])[0])]
    return (
        name,
        str(len(rows)),
        f"{len(fixed) / with_directions:.2f}" if with_directions else DASH,
        number(_median(fixed, "navigation_error"), 2),
        number(_median(fixed, "error"), 2),
        str(wilson(sum(nearer), len(nearer))) if nearer else DASH,
        str(_covered(fixed)) if fixed else DASH,
        number(_median(others, "navigation_error"), 2),
        number(_median(others, "error"), 2),
    )


def _fixed_and_others(rows: Sequence[Row]) -> tuple[list[Direction], list[Direction]]:
    """The directions of all rows that the covariance calls fixed, and the others."""
    some = [direction for row in rows for direction in directions(row)]
    return [each for each in some if each.is_fixed], [each for each in some if not each.is_fixed]


def _is_below_a_third(fixed: Sequence[Direction]) -> bool:
    """Whether a pair's error along its fixed directions is below a third of navigation's."""
    ours, navigation = (np.linalg.norm([getattr(each, n) for each in fixed]) for n in ("error", "navigation_error"))
    return bool(ours < FIXED * navigation)


def _covered(some: Sequence[Direction]) -> Rate:
    return wilson(sum(abs(direction.error) < WITHIN * direction.sigma for direction in some), len(some))


def _median(some: Sequence[Direction], name: str) -> float:
    return median(abs(getattr(direction, name)) for direction in some) if some else math.nan
