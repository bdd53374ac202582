"""What was recorded, as a section."""

from collections.abc import Sequence

from sonarmap.tools.lab.reproduce.beside import in_short
from sonarmap.tools.lab.reproduce.evidence.settings import EvidenceSettings
from sonarmap.tools.lab.reproduce.experiment import Row, Section
from sonarmap.tools.lab.reproduce.rows import grouped, percent, where
from sonarmap.tools.lab.reproduce.table import table_of

NEAR = 12.0, 8.0  # a place is right within these of the truth [degrees, voxels]


def near(row: Row) -> bool:
    """Whether a hypothesis names the right place, as far off as its pose may be there."""
    return float(row["rotation_deg"]) <= NEAR[0] and float(row["off_voxels"]) <= NEAR[1]


def evidence_section(rows: Sequence[Row], _: Sequence[Row], settings: EvidenceSettings) -> Section:
    """How many pairs of each set, and in how many the best hypothesis is near."""
    best = where(rows, rank=0)
    table = table_of(
        "Pairs that were recorded",
        ("set", "known"),
        list(grouped(best, "set", "known").items()),
        {
            "pairs": lambda some: str(len(some)),
            "of one place": lambda some: str(len(where(some, related=True))),
            "best within 8 voxels and 12 degrees": lambda some: percent([row for row in some if near(row)], some),
        },
    )
    beside = in_short([("pairs", str(len(best)), "what judging is fitted to")])
    return Section("Evidence", (beside, table))
