"""How the scans of `sonarmap map` are put together: loops, key scans, motion, and what a person says of them."""

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import TYPE_CHECKING

from sonarmap.tools.command.options.checks import checked, is_positive, length
from sonarmap.tools.command.options.option import EARTH, LOOPS, MOST, OUTPUT, option, refuse_without
from sonarmap.tools.command.options.registration import MethodOptions, changed
from sonarmap.tools.command.terminal import say

if TYPE_CHECKING:
    from sonarmap.slam.graph.control import ControlPoint
    from sonarmap.slam.mapper import MapperSettings
    from sonarmap.slam.tie import Tie
    from sonarmap.spectral.scan import Scan
    from sonarmap.tools.files.geo.georeference import Georeference


@dataclass(frozen=True, slots=True)
class SurveyOptions:
    """Loops, how fast the vehicle is, and the map's voxels."""

    loops: int | None = option(
        LOOPS,
        "N",
        "Loops to try per scan and round. 0 is none. Loops that connect distant parts of the track come "
        "first. There are two rounds, and more as long as they improve the poses.",
        shown="2",
        min=0,
        max=MOST,
    )
    max_speed: float | None = option(
        LOOPS,
        "M/S",
        "How fast the vehicle moves at most \\[m/s]; for scans whose stamps are times.",
        rare=True,
        callback=checked(is_positive, "{}; give a number above 0, or leave it out where it is not known"),
        shown="learned",
    )
    map_voxel: float | None = length(
        OUTPUT,
        "Edge of the map's voxels \\[m], finer or coarser than those that scans are registered by.",
        "--voxel",
        rare=True,
    )

    def mapper_settings(self, method: MethodOptions) -> "tuple[MapperSettings, MethodOptions]":
        """The same as the mapper takes it, with what --set says of the mapper, and the options of the method without
        that."""
        from sonarmap.slam.candidates.settings import LoopSettings
        from sonarmap.slam.mapper import MapperSettings
        from sonarmap.slam.motion.limits import MotionLimits

        settings = MapperSettings(
            LoopSettings() if self.loops is None else LoopSettings(per_scan=self.loops),
            MotionLimits() if self.max_speed is None else MotionLimits(self.max_speed),
            map_voxel=self.map_voxel,
        )
        known = {each.name for each in fields(MapperSettings)}
        own = [text for text in method.settings if text.partition("=")[0].partition(".")[0].strip() in known]
        others = [text for text in method.settings if text not in own]
        return changed(settings, own), replace(method, settings=others)


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
    control_crs: str | None = option(EARTH, "CRS", "CRS of the control file's coordinates, e.g. EPSG:25832.", rare=True)

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
