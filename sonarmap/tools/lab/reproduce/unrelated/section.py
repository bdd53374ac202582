"""Pairs that share nothing, in words and tables."""

import math
from collections.abc import Sequence

from sonarmap.tools.lab.reproduce.evaluation.methods import OURS
from sonarmap.tools.lab.reproduce.evaluation.settings import PairSetSettings
from sonarmap.tools.lab.reproduce.evaluation.summary import NOTHING, accepted, rate
from sonarmap.tools.lab.reproduce.experiment import Row, Section
from sonarmap.tools.lab.reproduce.rows import where
from sonarmap.tools.lab.reproduce.table import Table, verdict

PICTURE = "unrelated.png"


def unrelated_section(rows: Sequence[Row], settings: PairSetSettings) -> Section:
    """The requirement on ours, then what every method accepts, in all and by scene."""
    ours, methods = where(rows, method=OURS), settings.compared.methods
    false = accepted(ours)
    required = ((f"accepted by `{OURS}`", "none", rate(false, ours), verdict(not false)),)
    tables = [
        Table("Requirements", ("measure", "required", "ours", "verdict"), required if ours else ()),
        Table(
            "What each method accepts, and the highest values it reports for any of the pairs",
            ("method", "accepted", "highest probability", "highest PSR", "largest overlap"),
            tuple(_line(method, where(rows, method=method)) for method in methods),
        ),
        _by_scene(rows, methods),
    ]
    return Section(
        title="Pairs that share nothing",
        introduction=_introduction(rows, settings),
        tables=tuple(tables),
        times=(),
        pictures={PICTURE: "What the methods report for pairs that share nothing. Crosses are accepted registrations."},
    )


def _line(method: str, rows: Sequence[Row]) -> tuple[str, ...]:
    highest = (_highest(rows, "probability", ".4f"), _highest(rows, "psr", ".1f"), _highest(rows, "overlap", ".2f"))
    return (method, rate(accepted(rows), rows), *highest)


def _highest(rows: Sequence[Row], key: str, form: str) -> str:
    values = [float(row[key]) for row in rows if not math.isnan(float(row[key]))]
    return format(max(values), form) if values else NOTHING


def _by_scene(rows: Sequence[Row], methods: Sequence[str]) -> Table:
    scenes = list(dict.fromkeys(str(row["scene"]) for row in rows))
    lines = []
    for method in methods:
        by_scene = [where(rows, method=method, scene=scene) for scene in scenes]
        lines.append((method, *(f"{len(accepted(pairs))}/{len(pairs)}" for pairs in by_scene)))
    return Table("Accepted registrations, by the scene of the target", ("method", *scenes), tuple(lines))


def _introduction(rows: Sequence[Row], settings: PairSetSettings) -> str:
    count = len({row["number"] for row in rows})
    return (
        f"{count} pairs of scans that share nothing: their scenes are of different kinds, or of the same kind with "
        "different random plans. Both scans of a pair come from the same sensor, and the noise is that of the pairs "
        f"that overlap (set {settings.seed}). The grid has {settings.edge} voxels along each edge; their size is "
        f"chosen from the two scans. Every registration is wrong, so none should be accepted. {settings.compared.words}"
    )
