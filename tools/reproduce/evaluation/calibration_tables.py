"""How honest covariances and probabilities are, in tables."""

from collections.abc import Sequence

from tools.reproduce.evaluation.calibration_summary import calibration, reliability
from tools.reproduce.evaluation.methods import OURS
from tools.reproduce.evaluation.summary import NOTHING, OVERLAPS, right, shared
from tools.reproduce.experiment import Row
from tools.reproduce.rows import where
from tools.reproduce.table import Table


def calibration_table(yaw: Sequence[Row], free: Sequence[Row], methods: Sequence[str]) -> Table:
    """Normalized squared errors of right registrations: of ours by overlap, noise, scene and turn; of the others."""
    ours = right(where(yaw, method=OURS))
    cases: list[tuple[str, Sequence[Row]]] = [(f"{OURS}, any yaw", ours)] if OURS in methods else []
    if cases:
        cases += [(f"… {low:.0%}..{high:.0%} shared", shared(ours, low, high)) for low, high in OVERLAPS]
        cases += [(f"… σ² = {noise:g} m²", where(ours, sigma2=noise)) for noise in sorted({*_column(ours, "sigma2")})]
        cases += [(f"… {scene}", where(ours, scene=scene)) for scene in dict.fromkeys(_column(ours, "scene"))]
        cases += [("… accepted", where(ours, accepted=True))]
        cases += [(f"{OURS}, any rotation", right(where(free, method=OURS)))]
    cases += [(f"{name}, any yaw", right(where(yaw, method=name))) for name in methods if name != OURS]
    return Table(
        "Normalized squared errors of what is right (an honest covariance: mean 6, median 5.35, 95 % inside)",
        ("of", "registrations", "mean", "95 % of such means", "median", "in the 95 % ellipsoid", "the mean is"),
        tuple(_line(name, rows) for name, rows in cases if rows),
    )


def reliability_table(yaw: Sequence[Row], free: Sequence[Row]) -> Table:
    """The probability that ours tells beside how often it is right."""
    cases = (("any yaw", where(yaw, method=OURS)), ("any rotation", where(free, method=OURS)))
    lines = [
        (words, f"{one.low:g}..{one.high:g}", f"{one.predicted:.3f}", f"{one.share:.3f}", str(one.right))
        for words, rows in cases
        for one in reliability(rows)
    ]
    headings = ("pairs", "probability told", "its mean", "right", "right, with Wilson's interval")
    return Table(f"The probability that `{OURS}` tells", headings, tuple(lines))


def _line(name: str, rows: Sequence[Row]) -> tuple[str, ...]:
    found = calibration(rows)
    if found is None:
        return (name, str(len(rows)), *[NOTHING] * 5)
    inside = f"{found.share:.1%} [{found.inside.low:.1%}..{found.inside.high:.1%}]"
    interval = f"{found.low:.2f}..{found.high:.2f}"
    return (name, str(found.inside.trials), f"{found.mean:.2f}", interval, f"{found.median:.2f}", inside, found.verdict)


def _column(rows: Sequence[Row], key: str) -> list:
    return [row[key] for row in rows]
