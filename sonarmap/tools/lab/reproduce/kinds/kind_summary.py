"""Rows of the experiment on kinds of scans: whose scene can fix a pose, and which kind does worst."""

from collections.abc import Iterable, Sequence

from sonarmap.tools.lab.reproduce.evaluation.methods import OURS
from sonarmap.tools.lab.reproduce.evaluation.summary import NOTHING as DASH
from sonarmap.tools.lab.reproduce.evaluation.summary import accepted, right, wrong
from sonarmap.tools.lab.reproduce.experiment import Row
from sonarmap.tools.lab.reproduce.kinds.settings import LEVELED, NAVIGATION, NOTHING
from sonarmap.tools.lab.reproduce.rows import where

FLAT = "flat"  # the relief of scenes that cannot fix a pose
WORDS = {NOTHING: "nothing", LEVELED: "attitude, depth", NAVIGATION: "navigation"}  # as columns show what is known


def tried(rows: Iterable[Row]) -> list[Row]:
    """Those whose scene can fix a pose."""
    return [row for row in rows if row["relief"] != FLAT]


def without_navigation(rows: Iterable[Row]) -> list[Row]:
    """Those of the pairs that every kind has."""
    return [row for row in rows if row["priors"] != NAVIGATION]


def distinct(rows: Iterable[Row], key: str) -> list[str]:
    """The values of a column, in order."""
    return list(dict.fromkeys(str(row[key]) for row in rows))


def worst_first(rows: Sequence[Row]) -> list[str]:
    """The kinds, from the one with the least share right; of ours, or of all methods where ours did not run."""
    some = without_navigation(tried(rows))
    ours = where(some, method=OURS) or some

    def share(kind: str) -> float:
        of_kind = where(ours, kind=kind)
        return len(right(of_kind)) / max(len(of_kind), 1)

    return sorted(distinct(rows, "kind"), key=share)


def variants(rows: Sequence[Row]) -> list[tuple[str, str]]:
    """Every method with everything that it was given, but navigation; those of one method together."""
    some = without_navigation(rows)
    pairs = dict.fromkeys((str(row["method"]), str(row["priors"])) for row in some)
    methods = distinct(some, "method")
    return sorted(pairs, key=lambda pair: methods.index(pair[0]))


def variant_words(method: str, known: str) -> str:
    """For a heading."""
    return method if known == NOTHING else f"{method}, known: {WORDS[known]}"


def outcome(rows: Sequence[Row]) -> str:
    """Right, believed of the right, and wrong and believed, as in "93 %, 88 %, 1"; of no rows a dash."""
    good = right(rows)
    if not rows:
        return DASH
    believed = f"{len(accepted(good)) / len(good):.0%}".replace("%", " %") if good else DASH
    return f"{len(good) / len(rows):.0%}, ".replace("%", " %") + f"{believed}, {len(accepted(wrong(rows)))}"
