"""The experiment on kinds of scans in words."""

from collections.abc import Sequence

from sonarmap.tools.lab.evaluate.trajectory import RIGHT_DEG, RIGHT_VOXELS
from sonarmap.tools.lab.reproduce.beside import beside_table
from sonarmap.tools.lab.reproduce.experiment import Row, Section
from sonarmap.tools.lab.reproduce.kinds.calibration_tables import calibration_beside, reported_table
from sonarmap.tools.lab.reproduce.kinds.figure import OUTCOMES, RELIABILITY
from sonarmap.tools.lab.reproduce.kinds.settings import NAVIGATED, NAVIGATION, NAVIGATION_OVERLAPS, KindsSettings
from sonarmap.tools.lab.reproduce.kinds.tables import (
    FLAT,
    beside_others,
    kind_table,
    method_table,
    navigation_beside,
    navigation_table,
    relief_table,
    without_navigation,
)
from sonarmap.tools.lab.reproduce.methods import OURS
from sonarmap.tools.lab.reproduce.rows import where
from sonarmap.tools.lab.simulate.kinds.catalog import SCAN_KINDS
from sonarmap.tools.lab.simulate.kinds.kind import OVERLAPS

_REMARKS = (
    "The expected calibration error is a mean of absolute differences, so an exact probability has one too: the fewer "
    "the registrations, and the more probabilities lie in the middle, the larger. The tables show how large on average."
)


def kinds_section(rows: Sequence[Row], _seconds: Sequence[Row], settings: KindsSettings) -> Section:
    """Ours beside the others, then every method by kind and relief, then calibration and navigation of ours."""
    beside = beside_table([*beside_others(rows), *calibration_beside(rows), *navigation_beside(rows)])
    tables = [kind_table(rows), method_table(rows), relief_table(rows)]
    if where(rows, method=OURS):
        tables += [reported_table(rows), navigation_table(rows)]
    pictures = {
        OUTCOMES: "Right and wrong registrations by kind, the worst kind on top, without the flat scenes: believed "
        "(dark) or not (light)."
    }
    if without_navigation(where(rows, method=OURS)):
        pictures[RELIABILITY] = (
            f"How often `{OURS}` is right against the probability it reports, kind by kind, and the expected "
            "calibration error. The small numbers are counts of registrations."
        )
    return Section(
        title="Every kind of scan",
        introduction=_introduction(rows, settings),
        tables=(beside, *(table for table in tables if table.rows)),
        pictures=pictures,
        remarks=_REMARKS if RELIABILITY in pictures else "",
    )


def _introduction(rows: Sequence[Row], settings: KindsSettings) -> str:
    kinds = "; ".join(f"`{kind}`, {SCAN_KINDS[kind].summary}" for kind in settings.kinds)
    parts = [
        f"{settings.count} pairs of each kind (set {settings.seed}): {kinds}. The scans of a pair share "
        f"{100 * OVERLAPS[0][0]:.0f} to {100 * OVERLAPS[-1][1]:.0f} % of their points. The grid has {settings.edge} "
        "voxels along each edge; their size is chosen from the two scans. A registration is right if it is within "
        f"{RIGHT_DEG:g} degrees and {RIGHT_VOXELS:g} voxels of the truth, between the scans' frames. It is believed if "
        f"the method itself accepts it. Scenes whose relief is {FLAT} cannot fix a pose: they count only where wrong "
        f"registrations that are believed are counted of all, and in the calibration. {settings.compared.words} "
        "Methods that use priors register every pair with nothing known, and again with roll, pitch and depth of both "
        "scans measured about the truth (standard deviations 1.5 degrees and 0.15 m); the others get the points alone.",
        _navigated(rows),
        _missing(rows, settings),
    ]
    return "\n\n".join(part for part in parts if part)


def _navigated(rows: Sequence[Row]) -> str:
    if not where(rows, priors=NAVIGATION):
        return ""
    low, high = NAVIGATION_OVERLAPS
    return (
        f"Further pairs of the kind `{NAVIGATED}` share {100 * low:.0f} to {100 * high:.0f} % and are registered with "
        "navigation: attitude and heading with 1.5 degrees, depth with 0.15 m, East and North with 1 m of standard "
        "deviation, for each scan. The error of a registration's translation is looked at along the eigenvectors of "
        "its covariance, in the target's axes. The covariance calls a direction fixed where its standard deviation is "
        "below a third of navigation's in this direction, which also errs by the target's heading and attitude times "
        "the way to the source. The error of navigation alone is that of the pose between the two measured ones."
    )


def _missing(rows: Sequence[Row], settings: KindsSettings) -> str:
    counts = {
        kind: len({row["number"] for row in without_navigation(rows) if row["kind"] == kind}) for kind in settings.kinds
    }
    short = [f"{settings.count - count} of `{kind}`" for kind, count in counts.items() if count < settings.count]
    return f"Left out, because the scene has no such pair: {', '.join(short)}." if short else ""
