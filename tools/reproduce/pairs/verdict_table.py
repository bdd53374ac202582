"""What is wanted of ours on the pair set, beside what is found."""

from collections.abc import Sequence

from tools.reproduce.evaluation.calibration_summary import calibration
from tools.reproduce.evaluation.methods import OURS
from tools.reproduce.evaluation.summary import accepted, accurate, middle, rate, refused, shared, wrong
from tools.reproduce.experiment import Row
from tools.reproduce.pairs.tables import CLEAR
from tools.reproduce.rows import where
from tools.reproduce.table import Table

MOST_WRONG = 0.002  # of all pairs
MOST_REFUSED = 0.05  # of the pairs that share more than CLEAR
MEDIAN_DEG, MEDIAN_VOXELS = 0.3, 0.3
INSIDE = (0.93, 0.97)

_Line = tuple[str, str, str, str]


def verdict_table(yaw: Sequence[Row], free: Sequence[Row]) -> Table:
    """Empty where ours took no part."""
    lines: list[_Line] = []
    for words, rows in (("any yaw", where(yaw, method=OURS)), ("any rotation", where(free, method=OURS))):
        if rows:
            lines += [_believed(rows, words), _refused(rows, words)]
    ours = where(yaw, method=OURS)
    lines += [*_accuracy(accurate(ours)), *_calibration([row for row in ours if row["right"]])]
    return Table(f"What is wanted of `{OURS}`", ("what", "wanted", "ours", "verdict"), tuple(lines))


def _believed(rows: Sequence[Row], words: str) -> _Line:
    false = wrong(accepted(rows))
    holds = len(false) <= MOST_WRONG * len(rows)
    shown = f"{rate(false, rows)}; {len(accepted(rows))} accepted"
    return f"accepted yet wrong, {words}", f"at most {1000 * MOST_WRONG:g} of 1,000 pairs", shown, _verdict(holds)


def _refused(rows: Sequence[Row], words: str) -> _Line:
    clear = shared(rows, CLEAR)
    holds = len(refused(clear)) <= MOST_REFUSED * len(clear)
    what = f"refused though more than {CLEAR:.0%} is shared, {words}"
    return what, f"at most {MOST_REFUSED:.0%}", rate(refused(clear), clear), _verdict(holds)


def _accuracy(rows: Sequence[Row]) -> list[_Line]:
    if not rows:
        return []
    what = "median error of what is right, more than half shared, σ² up to 1 m²"
    degrees, voxels = middle(rows, "rotation_deg"), middle(rows, "translation_voxels")
    return [
        (f"{what} [°]", f"at most {MEDIAN_DEG:g}", f"{degrees:.3f}", _verdict(degrees <= MEDIAN_DEG)),
        (f"{what} [voxels]", f"at most {MEDIAN_VOXELS:g}", f"{voxels:.3f}", _verdict(voxels <= MEDIAN_VOXELS)),
    ]


def _calibration(rows: Sequence[Row]) -> list[_Line]:
    found = calibration(rows)
    if found is None:
        return []
    low, high = INSIDE
    mean = f"{found.mean:.2f}; 95 % of such means lie within {found.low:.2f}..{found.high:.2f}"
    inside = f"{found.share:.1%} ({found.inside})"
    return [
        ("mean normalized squared error of what is right", "6", mean, found.verdict),
        ("within the 95 % ellipsoid", f"{low:.0%} to {high:.0%}", inside, _verdict(low <= found.share <= high)),
    ]


def _verdict(holds: bool) -> str:
    return "holds" if holds else "does not hold"
