"""The pair set in tables: success and trust of every method, and the accuracy of what is right."""

from collections.abc import Sequence

from tools.reproduce.evaluation.summary import (
    OVERLAPS,
    accepted,
    accurate,
    middle,
    percent,
    rate,
    refused,
    right,
    shared,
    wrong,
)
from tools.reproduce.experiment import Row
from tools.reproduce.rows import where
from tools.reproduce.table import Table

CLEAR = 0.4  # of the points in common: more is to be believed


def overlap_table(rows: Sequence[Row], methods: Sequence[str], title: str) -> Table:
    """Right registrations by method and share in common, whether believed or not."""
    lines = []
    for method in methods:
        some = where(rows, method=method)
        held = [shared(some, low, high) for low, high in OVERLAPS]
        lines.append((method, *(percent(right(one), one) for one in held), rate(right(some), some)))
    count = [len(shared(where(rows, method=methods[0]), low, high)) for low, high in OVERLAPS]
    spans = (f"{low:.0%}..{high:.0%}: {n}" for (low, high), n in zip(OVERLAPS, count, strict=True))
    return Table(f"{title} (in the head: how many pairs)", ("method", *spans, "all"), tuple(lines) if rows else ())


def trust_table(rows: Sequence[Row], methods: Sequence[str], title: str) -> Table:
    """What is accepted and what is refused, rightly or not."""
    lines = []
    for method in methods:
        some = where(rows, method=method)
        clear = shared(some, CLEAR)
        lines.append(
            (
                method,
                f"{len(accepted(some))}/{len(some)}",
                rate(wrong(accepted(some)), some),
                f"{len(wrong(accepted(some)))}/{len(accepted(some))}",
                rate(refused(clear), clear),
                rate(refused(right(some)), right(some)),
            )
        )
    headings = (
        "method",
        "accepted",
        "accepted yet wrong, of all",
        "of accepted",
        f"refused though > {CLEAR:.0%} shared",
    )
    return Table(title, (*headings, "refused though right, of right"), tuple(lines) if rows else ())


def scene_table(rows: Sequence[Row], methods: Sequence[str]) -> Table:
    """Right registrations by method and scene, and how often they are believed wrongly."""
    scenes = list(dict.fromkeys(str(row["scene"]) for row in rows))
    lines = []
    for method in methods:
        some = [where(rows, method=method, scene=scene) for scene in scenes]
        lines.append((method, *(f"{percent(right(one), one)}, {len(wrong(accepted(one)))}" for one in some)))
    title = "Right by scene, and how many are accepted though wrong: any yaw, tilt up to 35 degrees"
    return Table(title, ("method", *scenes), tuple(lines) if rows else ())


def accuracy_table(rows: Sequence[Row], methods: Sequence[str]) -> Table:
    """Errors of right registrations of pairs that share much, under little noise."""
    lines = []
    for method in methods:
        some = accurate(where(rows, method=method))
        if some:
            errors = (f"{middle(some, 'rotation_deg'):.3f}", f"{middle(some, 'translation_voxels'):.3f}")
            lines.append((method, str(len(some)), *errors, f"{middle(some, 'translation_m'):.3f}"))
    title = "Median errors of what is right, more than half shared, σ² up to 1 m²: any yaw, tilt up to 35 degrees"
    return Table(title, ("method", "registrations", "degrees", "voxels", "m"), tuple(lines))
