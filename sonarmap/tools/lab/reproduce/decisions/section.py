"""How maps come out by each rule of the graph, as a section."""

from collections.abc import Callable, Mapping, Sequence
from statistics import median
from typing import Any

from sonarmap.tools.lab.reproduce.beside import in_short
from sonarmap.tools.lab.reproduce.experiment import Row, Section
from sonarmap.tools.lab.reproduce.rows import column, grouped, in_percent, where
from sonarmap.tools.lab.reproduce.survey.row import ROLES
from sonarmap.tools.lab.reproduce.table import Table, table_of
from sonarmap.tools.lab.simulate.kinds.kind import relief_of


def decisions_section(rows: Sequence[Row], _: Sequence[Row], settings: Any) -> Section:
    """Every rule, over rich scenes and over weak relief, and every scene as usual, the worst first."""
    reliefs = [{**row, "relief": relief_of(str(row["scene"]))} for row in rows]
    rules = grouped(reliefs, "rule", "relief")
    usual = where(rows, rule=rows[0]["rule"])
    scenes = sorted(
        grouped(usual, "scene").items(), key=lambda each: -float(median(column(each[1], "ate_after_voxels")))
    )
    surveys = sorted(usual, key=lambda row: -float(row["ate_after_voxels"]))[:_WORST]
    tables = (
        _in_short(usual),
        table_of("What each rule is worth", ("rule", "relief"), rules.items(), _COLUMNS),
        table_of("By scene", ("scene",), scenes, _COLUMNS),
        table_of(
            "The worst maps", ("survey",), [((f"{row['scene']} {row['seed']}",), [row]) for row in surveys], _COLUMNS
        ),
    )
    return Section("Decisions of the graph", tables)


_WORST = 10


def _in_short(rows: Sequence[Row]) -> Table:
    lines = [
        ("error of a map, median and worst [voxels]", "ATE [voxels]", "how far off a map is"),
        ("wrong of the kept pairs", "wrong of the kept", "what bends a map"),
        ("poses in their 95 % ellipsoid", "in the ellipsoid", "how far a map's sigmas can be trusted"),
    ]
    return in_short((words, _COLUMNS[name](rows), follows) for words, name, follows in lines)


def _sum(rows: Sequence[Row], *fates: str) -> int:
    return sum(int(row[f"{role}_{fate}"]) for row in rows for role in ROLES for fate in fates)


def _share(rows: Sequence[Row]) -> float:
    """Of poses in their ellipsoids, over all surveys."""
    return float((column(rows, "within_95") * (column(rows, "placed") - 1)).sum() / (column(rows, "placed") - 1).sum())


_COLUMNS: Mapping[str, Callable[[Sequence[Row]], str]] = {
    "surveys": lambda rows: str(len(rows)),
    "in one map": lambda rows: str(sum(row["placed"] == row["scans"] for row in rows)),
    "ATE [voxels]": lambda rows: (
        f"{median(column(rows, 'ate_after_voxels')):.2f}, {column(rows, 'ate_after_voxels').max():.2f}"
    ),
    "wrong of the kept": lambda rows: f"{_sum(rows, 'kept_wrong')} of {_sum(rows, 'kept_right', 'kept_wrong')}",
    "right but refused": lambda rows: str(_sum(rows, "refused_right")),
    "in the ellipsoid": lambda rows: in_percent(_share(rows), 1),
    "the worst survey": lambda rows: in_percent(float(column(rows, "within_95").min())),
    "mean nees": lambda rows: f"{column(rows, 'nees_mean').mean():.1f}",
}
