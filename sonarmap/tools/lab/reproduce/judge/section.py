"""How judging does on recorded evidence, as a section."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any

from sonarmap.tools.lab.reproduce.beside import in_short
from sonarmap.tools.lab.reproduce.experiment import Row, Section
from sonarmap.tools.lab.reproduce.rows import DASH, in_percent, where
from sonarmap.tools.lab.reproduce.table import Table, table_of

LEFT_OUT = "set left out"  # in place of a rule: each set judged by a fit to the others


def judge_section(rows: Sequence[Row], _: Sequence[Row], settings: Any) -> Section:
    """Every rule with and without, then group by group, the worst first, and each set left out of the fit."""
    whole = rows[0]["rule"]
    rules = [((str(row["rule"]),), row) for row in where(rows, by="all") if row["rule"] != LEFT_OUT]
    tables = [table_of("What each rule is worth", ("rule",), rules, _COLUMNS)]
    tables += [_by(where(rows, rule=whole, by=by), by) for by in ("known", "set", "scene", "edge")]
    tables.append(_by(where(rows, rule=LEFT_OUT, by="set"), "set left out of the fit"))
    return Section("Judgement", (_beside(rows[0]), *tables))


def _beside(row: Row) -> Table:
    lines = [
        ("right places that are believed", "believed of the right", "places that a map can use"),
        ("wrong places that are believed", "wrong and believed", "what a map has to find out by itself"),
        ("truths in the 95 % ellipsoid", "in the 95 % ellipsoid", "how far covariances can be trusted"),
    ]
    return in_short((words, _COLUMNS[name](row), follows) for words, name, follows in lines)


def _by(rows: Sequence[Row], name: str) -> Table:
    """A line for each group, those that believe least of what is right first."""
    ordered = sorted(rows, key=lambda row: float(row["believed_right"]) / max(float(row["right"]), 1.0))
    return table_of(f"By {name}", (name,), [((str(row["group"]),), row) for row in ordered], _COLUMNS)


def _share(hits: str, of: str) -> Callable[[Row], str]:
    return lambda row: in_percent(float(row[hits]) / float(row[of]), 1) if row[of] else DASH


_COLUMNS: Mapping[str, Callable[[Row], str]] = {
    "pairs": lambda row: str(row["pairs"]),
    "right": lambda row: str(row["right"]),
    "believed of the right": _share("believed_right", "right"),
    "wrong and believed": lambda row: str(row["believed_wrong"]),
    "accepted of the right": _share("accepted_right", "right"),
    "wrong and accepted": lambda row: str(row["accepted_wrong"]),
    "calibration error": lambda row: f"{float(row['calibration_error']):.3f}",
    "in the 95 % ellipsoid": _share("inside", "near"),
    "mean nees": lambda row: f"{float(row['nees']):.2f}" if row["near"] else DASH,
    "open": _share("open", "near"),
}
