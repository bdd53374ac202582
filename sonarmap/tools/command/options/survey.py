"""How the scans of `sonarmap map` are put together: loops, key scans, motion, and what a person says of them."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from sonarmap.tools.command.options.checks import checked, is_positive, length
from sonarmap.tools.command.options.option import EARTH, LOOPS, MOST, OUTPUT, flag, option, refuse_without
from sonarmap.tools.command.terminal import say

if TYPE_CHECKING:
    from sonarmap.slam.graph.control import ControlPoint
    from sonarmap.slam.mapper import MapperSettings
    from sonarmap.slam.tie import Tie
    from sonarmap.spectral.scan import Scan
    from sonarmap.tools.files.geo.georeference import Georeference

_limit = partial(
    option,
    LOOPS,
    rare=True,
    callback=checked(is_positive, "{}; give a number above 0, or leave it out where it is not known"),
)


@dataclass(frozen=True, slots=True)
class SurveyOptions:
    """Loops, key scans, and what the vehicle's motion cannot exceed."""

    loops: int | None = option(
        LOOPS,
        "N",
        "Loops to try per scan and round. 0 is none. Loops that connect distant parts of the track come "
        "first. There are two rounds, and more as long as they improve the poses.",
        shown="2",
        min=0,
        max=MOST,
    )
    key_step: float | None = _limit(
        "M",
        "Distance of key scans \\[m]. Loops are sought among these; the others are registered to the nearest of them.",
        shown="automatic for dense streams",
    )
    max_speed: float | None = _limit(
        "M/S", "How fast the vehicle moves at most \\[m/s]; for scans whose stamps are times.", shown="learned"
    )
    max_turn_rate: float | None = _limit(
        "DEG/S", "How fast it turns at most \\[deg/s]; for scans whose stamps are times.", shown="learned"
    )
    max_step: float | None = _limit("M", "How far apart consecutive scans are at most \\[m].", shown="learned")
    min_seen: int | None = option(
        OUTPUT,
        "N",
        "Drop points seen by fewer than N scans and contradicted by others. map_all.ply keeps all points; 1 drops "
        "none.",
        rare=True,
        shown="2",
        min=1,
        max=MOST,
    )

    map_voxel: float | None = length(
        OUTPUT,
        "Edge of the map's voxels \\[m], finer or coarser than those that scans are registered by.",
        "--voxel",
        rare=True,
    )
    straighten: bool = flag(
        LOOPS, "--straighten/--no-straighten", "Straighten scans whose points have times.", True, rare=True
    )

    def mapper_settings(self) -> "MapperSettings":
        """The same as the mapper takes it; None leaves the default."""
        from sonarmap.slam.candidates.settings import LoopSettings
        from sonarmap.slam.map.component_maps import MIN_SEEN
        from sonarmap.slam.mapper import MapperSettings
        from sonarmap.slam.motion.limits import MotionLimits
        from sonarmap.slam.stream.keys import KeySettings

        limits = MotionLimits(
            speed=math.inf if self.max_speed is None else self.max_speed,
            turn_rate=math.inf if self.max_turn_rate is None else math.radians(self.max_turn_rate),
            step=math.inf if self.max_step is None else self.max_step,
        )
        return MapperSettings(
            LoopSettings() if self.loops is None else LoopSettings(per_scan=self.loops),
            limits,
            KeySettings(self.key_step),
            map_voxel=self.map_voxel,
            min_seen=MIN_SEEN if self.min_seen is None else self.min_seen,
            straighten=self.straighten,
        )


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
