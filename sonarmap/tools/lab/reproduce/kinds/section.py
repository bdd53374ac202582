"""The experiment on kinds of scans in words."""

from collections.abc import Sequence

from sonarmap.tools.lab.reproduce.beside import beside_table
from sonarmap.tools.lab.reproduce.experiment import Row, Section
from sonarmap.tools.lab.reproduce.kinds.calibration_tables import calibration_beside, reported_table
from sonarmap.tools.lab.reproduce.kinds.figure import OUTCOMES, RELIABILITY
from sonarmap.tools.lab.reproduce.kinds.settings import KindsSettings
from sonarmap.tools.lab.reproduce.kinds.tables import (
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
        tables=(beside, *(table for table in tables if table.rows)),
        pictures=pictures,
    )
