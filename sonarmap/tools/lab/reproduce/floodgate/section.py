"""The flood gate's maps in words and tables."""

from collections.abc import Sequence
from typing import Any

from sonarmap.tools.lab.reproduce.experiment import Row, Section
from sonarmap.tools.lab.reproduce.floodgate.figure import PICTURES
from sonarmap.tools.lab.reproduce.floodgate.tables import (
    map_table,
    pair_table,
    pose_table,
    times_tables,
    verdict_table,
)


def floodgate_section(rows: Sequence[Row], seconds: Sequence[Row], settings: Any) -> Section:
    """The paper's statements next to our results, errors, and Table 2; `settings` are FloodgateSettings."""
    return Section(
        title="A flood gate, eighteen scans: Sect. 4, Table 2, Figs. 22 to 31",
        tables=(verdict_table(rows), map_table(rows), pair_table(rows), pose_table(rows)),
        times=times_tables(seconds),
        pictures=PICTURES,
    )
