"""What a person says of a survey: --ties and --control."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from sonarmap.tools.command.options.groups import EARTH, LOOPS
from sonarmap.tools.command.options.option import option, refuse_without
from sonarmap.tools.command.terminal import say

if TYPE_CHECKING:
    from sonarmap.slam.graph.control import ControlPoint
    from sonarmap.slam.tie import Tie
    from sonarmap.spectral.scan import Scan
    from sonarmap.tools.files.geo.georeference import Georeference


@dataclass(frozen=True, slots=True)
class TiesAndControl:
    """Pairs and points with a person's verdict or coordinates."""

    ties: Path | None = option(
        LOOPS,
        "FILE",
        "Accept, reject or add pairs of scans, by a CSV. Its columns are target, source and verdict (docs/ties.md). "
        "What is registered already is not registered again.",
    )
    control: Path | None = option(
        EARTH,
        "FILE",
        "Hold points to known coordinates, by a CSV. Its columns are name, scan, x_m, y_m, z_m and east_m, north_m, "
        "up_m or others (docs/ties.md).",
    )
    control_crs: str | None = option(EARTH, "CRS", "Of its easting_m and northing_m, as EPSG:25832.", rare=True)

    def read_ties(self, scans: "Sequence[Scan]") -> "tuple[Tie, ...]":
        """What --ties says of pairs of the scans; none without it. Raises InputError: the file cannot be used."""
        from sonarmap.tools.files.readers.ties import read_ties

        return () if self.ties is None else read_ties(self.ties, scans)

    def read_control(
        self, scans: "Sequence[Scan]", georeference: "Georeference | None"
    ) -> "tuple[tuple[ControlPoint, ...], Georeference | None]":
        """The points of --control, and where the map lies on the Earth then; by now it lies at `georeference`.

        Raises InputError: the file cannot be used, or --control-crs has no file.
        """
        from sonarmap.tools.files.readers.control import read_control

        if self.control is None:
            refuse_without("--control", {"--control-crs": self.control_crs})
            return (), georeference
        read = read_control(self.control, scans, georeference, self.control_crs)
        for note in read.notes:
            say(note)
        return read.points, read.georeference
