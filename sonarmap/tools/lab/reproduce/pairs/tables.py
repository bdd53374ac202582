"""The pair set in tables: requirements, success and acceptance of every method, accuracy of right registrations."""

from collections.abc import Sequence

from sonarmap.tools.lab.reproduce.evaluation.calibration_tables import calibration
from sonarmap.tools.lab.reproduce.evaluation.methods import OURS
from sonarmap.tools.lab.reproduce.evaluation.summary import (
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
from sonarmap.tools.lab.reproduce.experiment import Row
from sonarmap.tools.lab.reproduce.rows import where
from sonarmap.tools.lab.reproduce.table import Table, verdict

CLEAR = 0.4  # of the points in common: pairs that share more should be accepted


def overlap_table(rows: Sequence[Row], methods: Sequence[str], title: str) -> Table:
    """Right registrations by method and overlap, whether accepted or not."""
    lines = []
    for method in methods:
        some = where(rows, method=method)
        by_overlap = [shared(some, low, high) for low, high in OVERLAPS]
        lines.append((method, *(percent(right(pairs), pairs) for pairs in by_overlap), rate(right(some), some)))
    count = [len(shared(where(rows, method=methods[0]), low, high)) for low, high in OVERLAPS]
    spans = (f"{low:.0%}..{high:.0%} ({n} pairs)" for (low, high), n in zip(OVERLAPS, count, strict=True))
    title = f"{title}. The headings say how many pairs `{methods[0]}` registers"
    return Table(title, ("method", *spans, "all"), tuple(lines) if rows else ())


def trust_table(rows: Sequence[Row], methods: Sequence[str], title: str) -> Table:
    """How many registrations are accepted and refused, rightly or not."""
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
        "accepted though wrong, of all",
        "accepted though wrong, of the accepted",
        f"refused, of those that share > {CLEAR:.0%}",
        "refused though right, of the right",
    )
    return Table(title, headings, tuple(lines) if rows else ())


def scene_table(rows: Sequence[Row], methods: Sequence[str]) -> Table:
    """Right registrations by method and scene, and how many are accepted though wrong."""
    scenes = list(dict.fromkeys(str(row["scene"]) for row in rows))
    lines = []
    for method in methods:
        by_scene = [where(rows, method=method, scene=scene) for scene in scenes]
        cells = (f"{percent(right(pairs), pairs)}, {len(wrong(accepted(pairs)))}" for pairs in by_scene)
        lines.append((method, *cells))
    title = "Right registrations by scene, then how many are accepted though wrong: any yaw, tilt up to 35 degrees"
    return Table(title, ("method", *scenes), tuple(lines) if rows else ())


def accuracy_table(rows: Sequence[Row], methods: Sequence[str]) -> Table:
    """Errors of right registrations of pairs that share much, under little noise."""
    lines = []
    for method in methods:
        some = accurate(where(rows, method=method))
        if some:
            errors = (f"{middle(some, 'rotation_deg'):.3f}", f"{middle(some, 'translation_voxels'):.3f}")
            lines.append((method, str(len(some)), *errors, f"{middle(some, 'translation_m'):.3f}"))
    title = "Median errors of right registrations, more than half shared, σ² up to 1 m²: any yaw, tilt up to 35 degrees"
    headings = ("method", "registrations", "rotation [°]", "translation [voxels]", "translation [m]")
    return Table(title, headings, tuple(lines))


MOST_WRONG = 0.002  # of all pairs
MOST_REFUSED = 0.05  # of the pairs that share more than CLEAR
MEDIAN_DEG, MEDIAN_VOXELS = 0.3, 0.3
INSIDE = (0.93, 0.97)

_Line = tuple[str, str, str, str]


def verdict_table(yaw: Sequence[Row], free: Sequence[Row]) -> Table:
    """The requirements; no rows where ours did not run."""
    lines: list[_Line] = []
    for words, rows in (("any yaw", where(yaw, method=OURS)), ("any rotation", where(free, method=OURS))):
        if rows:
            lines += [_accepted_wrong(rows, words), _refused(rows, words)]
    ours = where(yaw, method=OURS)
    lines += [*_accuracy(accurate(ours)), *_calibration([row for row in ours if row["right"]])]
    return Table(f"Requirements on `{OURS}`", ("measure", "required", "ours", "verdict"), tuple(lines))


def _accepted_wrong(rows: Sequence[Row], words: str) -> _Line:
    false = wrong(accepted(rows))
    holds = len(false) <= MOST_WRONG * len(rows)
    shown = f"{rate(false, rows)}; {len(accepted(rows))} accepted"
    return f"accepted yet wrong, {words}", f"at most {1000 * MOST_WRONG:g} of 1,000 pairs", shown, verdict(holds)


def _refused(rows: Sequence[Row], words: str) -> _Line:
    clear = shared(rows, CLEAR)
    holds = len(refused(clear)) <= MOST_REFUSED * len(clear)
    what = f"refused though more than {CLEAR:.0%} is shared, {words}"
    return what, f"at most {MOST_REFUSED:.0%}", rate(refused(clear), clear), verdict(holds)


def _accuracy(rows: Sequence[Row]) -> list[_Line]:
    if not rows:
        return []
    what = "median error of what is right, more than half shared, σ² up to 1 m²"
    degrees, voxels = middle(rows, "rotation_deg"), middle(rows, "translation_voxels")
    return [
        (f"{what} [°]", f"at most {MEDIAN_DEG:g}", f"{degrees:.3f}", verdict(degrees <= MEDIAN_DEG)),
        (f"{what} [voxels]", f"at most {MEDIAN_VOXELS:g}", f"{voxels:.3f}", verdict(voxels <= MEDIAN_VOXELS)),
    ]


def _calibration(rows: Sequence[Row]) -> list[_Line]:
    ours = calibration(rows)
    if ours is None:
        return []
    low, high = INSIDE
    mean = f"{ours.mean:.2f}; 95 % of such means lie within {ours.low:.2f}..{ours.high:.2f}"
    inside = f"{ours.share:.1%} ({ours.inside})"
    return [
        ("mean normalized squared error of what is right", "6", mean, ours.verdict),
        ("within the 95 % ellipsoid", f"{low:.0%} to {high:.0%}", inside, verdict(low <= ours.share <= high)),
    ]
