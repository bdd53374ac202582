"""Where the right pose was lost, as a section."""

from collections.abc import Callable, Mapping, Sequence

from sonarmap.tools.lab.reproduce.beside import in_short
from sonarmap.tools.lab.reproduce.experiment import Row, Section
from sonarmap.tools.lab.reproduce.funnel.settings import FunnelSettings
from sonarmap.tools.lab.reproduce.rows import DASH, grouped
from sonarmap.tools.lab.reproduce.table import table_of

# Heading -> the column of ranks
_STAGES = {
    "rotation named": "rotations",
    "place named": "candidates",
    "refined by few points": "few_points",
    "by more": "more_points",
    "roughly": "rough",
    "compared": "compared",
}
_GIVEN = {
    "right": "right_given_nothing",
    "right, the true rotation given": "right_given_rotation",
    "right, the true pose given": "right_given_pose",
}


def funnel_section(rows: Sequence[Row], _: Sequence[Row], settings: FunnelSettings) -> Section:
    """The share of pairs in which the truth is left, stage by stage, by kind and by step of Table 1."""
    columns: Mapping[str, Callable[[list[Row]], str]] = {
        "pairs": lambda some: str(len(some)),
        **{
            heading: lambda some, name=name: _share(some, lambda row: float(row[name]) >= 0)
            for heading, name in _STAGES.items()
        },
        "first in the end": lambda some: _share(some, lambda row: row["final"] == 0),
        **{heading: lambda some, name=name: _share(some, lambda row: row[name]) for heading, name in _GIVEN.items()},
    }
    curved = [row for row in rows if row["relief"] != "flat"]
    table = table_of(
        "What is left of the truth, stage by stage", ("set",), list(grouped(curved, "set").items()), columns
    )
    right = _share(curved, lambda row: row["right_given_nothing"])
    gained = _share(curved, lambda row: row["right_given_pose"])
    beside = in_short(
        [
            ("right", right, "where the truth is named and wins"),
            ("right, the true pose given", gained, "what better candidates could give at most"),
        ]
    )
    introduction = (
        f"{len(curved)} pairs drawn with the seed {settings.seed}, with nothing known but the points: of every kind of "
        "scan, and of the steps S8 to S12 of the paper's Table 1, continued, under three noises. A rotation is named "
        "if one that is followed is within 12 degrees of the truth; a place, if a candidate is within 12 degrees and 8 "
        "voxels; right is within 6 degrees and 3 voxels in the end. Flat scenes are left out."
    )
    return Section("Where the right pose is lost", introduction, (beside, table))


def _share(rows: list[Row], is_there: Callable[[Row], object]) -> str:
    return f"{sum(map(bool, map(is_there, rows))) / len(rows):.0%}" if rows else DASH
