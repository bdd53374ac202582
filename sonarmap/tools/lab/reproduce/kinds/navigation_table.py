"""Swaths with navigation: what registration adds to it, along the directions that the terrain fixes and the others."""

from collections.abc import Sequence
from statistics import median

import numpy as np

from sonarmap.tools.lab.reproduce.evaluation.methods import OURS
from sonarmap.tools.lab.reproduce.evaluation.summary import NOTHING as DASH
from sonarmap.tools.lab.reproduce.evaluation.summary import accepted
from sonarmap.tools.lab.reproduce.experiment import Row
from sonarmap.tools.lab.reproduce.kinds.kind_summary import tried
from sonarmap.tools.lab.reproduce.kinds.navigation import FIXED, Direction, directions
from sonarmap.tools.lab.reproduce.kinds.settings import NAVIGATION
from sonarmap.tools.lab.reproduce.kinds.tables import Line
from sonarmap.tools.lab.reproduce.rate import Rate, wilson
from sonarmap.tools.lab.reproduce.rows import where
from sonarmap.tools.lab.reproduce.table import Table, verdict
from sonarmap.tools.lab.simulate.kinds.kind import RELIEFS

WITHIN = 2.0  # standard deviations
COVERED = 0.88  # least share of the errors within them


def navigation_requirements(rows: Sequence[Row]) -> list[Line]:
    """Along the directions that the covariance calls fixed: measure, required, ours, verdict."""
    rows = tried(where(rows, method=OURS, priors=NAVIGATION))
    fixed = _fixed(rows)
    words = "swaths with navigation, directions that the covariance calls fixed"
    if not fixed:
        return [(words, "some", f"none in {len(rows)} pairs", verdict(False))] if rows else []
    ours, navigation = _median(fixed, "error"), _median(fixed, "navigation_error")
    covered = _covered(fixed)
    return [
        (
            f"{words}: median error",
            "below a third of navigation's",
            f"{ours:.2f} m; navigation's {navigation:.2f} m",
            verdict(ours < FIXED * navigation),
        ),
        (
            f"{words}: errors within {WITHIN:g} standard deviations",
            f"at least {COVERED:.0%}".replace("%", " %"),
            str(covered),
            verdict(covered.successes >= COVERED * covered.trials),
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
    known = [row for row in rows if directions(row)]
    fixed = _fixed(known)
    others = [direction for row in known for direction in directions(row) if not direction.is_fixed]
    nearer = [below for row in known if (below := _is_below_a_third(row)) is not None]
    return (
        name,
        str(len(rows)),
        f"{len(fixed) / len(known):.2f}" if known else DASH,
        _shown(fixed, "navigation_error"),
        _shown(fixed, "error"),
        str(wilson(sum(nearer), len(nearer))) if nearer else DASH,
        str(_covered(fixed)) if fixed else DASH,
        _shown(others, "navigation_error"),
        _shown(others, "error"),
    )


def _fixed(rows: Sequence[Row]) -> list[Direction]:
    return [direction for row in rows for direction in directions(row) if direction.is_fixed]


def _is_below_a_third(row: Row) -> bool | None:
    """Whether a pair's error along all its fixed directions is; None where none is fixed."""
    fixed = [direction for direction in directions(row) if direction.is_fixed]
    if not fixed:
        return None
    ours, navigation = (
        float(np.linalg.norm(errors))
        for errors in ([direction.error for direction in fixed], [direction.navigation_error for direction in fixed])
    )
    return ours < FIXED * navigation


def _covered(some: Sequence[Direction]) -> Rate:
    return wilson(sum(abs(direction.error) < WITHIN * direction.sigma for direction in some), len(some))


def _median(some: Sequence[Direction], name: str) -> float:
    return median(abs(getattr(direction, name)) for direction in some)


def _shown(some: Sequence[Direction], name: str) -> str:
    return f"{_median(some, name):.2f}" if some else DASH
