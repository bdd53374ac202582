"""Pairs that share nothing, in words and tables."""

import math
from collections.abc import Sequence

from tools.reproduce.evaluation.methods import OURS
from tools.reproduce.evaluation.settings import PairSetSettings
from tools.reproduce.evaluation.summary import NOTHING, accepted, rate
from tools.reproduce.experiment import Row, Section
from tools.reproduce.rows import where
from tools.reproduce.table import Table, verdict

PICTURE = "unrelated.png"


def unrelated_section(rows: Sequence[Row], settings: PairSetSettings) -> Section:
    """What ours believes, then every method, then ours by scene."""
    ours, methods = where(rows, method=OURS), settings.compared.methods
    false = accepted(ours)
    wanted = ((f"accepted by `{OURS}`", "none", rate(false, ours), verdict(not false)),)
    tables = [
        Table("What is wanted", ("what", "wanted", "ours", "verdict"), wanted if ours else ()),
        Table(
            "What each method believes, and the most that it says for a pair that shares nothing",
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
        pictures={PICTURE: "What the methods say of pairs that share nothing; accepted ones are crosses."},
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
        some = [where(rows, method=method, scene=scene) for scene in scenes]
        lines.append((method, *(f"{len(accepted(one))}/{len(one)}" for one in some)))
    return Table("Accepted by the target's scene", ("method", *scenes), tuple(lines))


def _introduction(rows: Sequence[Row], settings: PairSetSettings) -> str:
    count = len({row["number"] for row in rows})
    return (
        f"{count} pairs of scans that share nothing: of scenes of different kinds, or of one kind whose plan is drawn "
        f"anew, seen with the same sensor, with the noise of the related pairs (set {settings.seed}). The grid has "
        f"{settings.edge} voxels an edge, their size chosen from the two scans. No answer is right. "
        f"{settings.compared.words}"
    )
