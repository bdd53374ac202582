"""How a file of navigation is to be understood, as far as the file itself does not say."""

import csv
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import TYPE_CHECKING, Literal

import numpy as np

from sonarmap.kernels.errors import InputError
from sonarmap.tools.files.readers.navigation.headings import QUANTITIES
from sonarmap.tools.files.readers.navigation.mount import Mount
from sonarmap.tools.files.time_scales import TIME_SCALES, TimeScale

if TYPE_CHECKING:
    from sonarmap.tools.files.geo.georeference import Georeference

NavFrame = Literal["frd", "ned", "flu", "enu"]
# frd and ned are the two halves of one convention, the vehicle's and the world's; flu and enu those of the other
DOWN_FRAMES: tuple[NavFrame, ...] = ("frd", "ned")
UP_FRAMES: tuple[NavFrame, ...] = ("flu", "enu")
NAV_FRAMES = DOWN_FRAMES + UP_FRAMES
HEADING_REFERENCES = ("true", "grid")
_MOST_OFFSET = 1e10  # [s]: more than 300 years
_NOTHING: MappingProxyType[str, str] = MappingProxyType({})


@dataclass(frozen=True, slots=True)
class NavigationSettings:
    """How to read navigation; the defaults suit a file with the columns and signs of docs/navigation.md.

    Attributes:
        columns: {quantity: the heading of its column}, where the headings do not say it.
        time_scale: of times that do not name their zone; None for UTC, and GPS time for weeks.
        offset: to be added to its times [s]; None to have it estimated from turn rates.
        crs: of eastings and northings, as EPSG:32632.
        origin: of the map's frame; None for the first fix, if the file has places on the Earth.
        heading_reference: "true" or "grid" (the North of `crs`, or of the UTM zone).
        declination: to be added to headings that are magnetic [deg], East positive; None where they are not.
        frame: of NAV_FRAMES, the convention of roll, pitch, yaw and of x, y, z; None for headings, pitch nose up, and
            no yaw and no z.
        mount: of the sonar on the vehicle.

    Raises:
        InputError: a name that is not known, or a number that is not finite.
    """

    columns: MappingProxyType[str, str] = field(default_factory=lambda: _NOTHING)
    time_scale: TimeScale | None = None
    offset: float | None = 0.0
    crs: str | None = None
    origin: "Georeference | None" = None
    heading_reference: str = "true"
    declination: float | None = None
    frame: NavFrame | None = None
    mount: Mount | None = None

    def __post_init__(self) -> None:
        _require_one_of("--time-scale", self.time_scale, TIME_SCALES)
        _require_one_of("--nav-frame", self.frame, NAV_FRAMES)
        if self.heading_reference == "magnetic":
            raise InputError(
                "--heading-reference magnetic: the declination of the place and year is not known here; give it as "
                "--magnetic-declination DEG (East positive) and leave --heading-reference out"
            )
        _require_one_of("--heading-reference", self.heading_reference, HEADING_REFERENCES)
        if self.offset is not None and not abs(self.offset) <= _MOST_OFFSET:
            raise InputError(f"--nav-offset is {self.offset:g}; wanted seconds within {_MOST_OFFSET:g}")
        if self.declination is not None and not abs(self.declination) <= 180:
            raise InputError(
                f"--magnetic-declination is {self.declination:g}; wanted degrees within 180, East positive"
            )
        if self.declination is not None and self.heading_reference == "grid":
            raise InputError(
                "--magnetic-declination is of magnetic headings, not of grid headings; give only one of both"
            )

    @property
    def points_up(self) -> bool:
        """Whether its axes are forward, left, up in East, North, Up: pitch nose down, yaw from East to North."""
        return self.frame in UP_FRAMES


def _require_one_of(option: str, value: str | None, known: tuple[str, ...]) -> None:
    if value is not None and value not in known:
        raise InputError(f"{option} is {value!r}; wanted one of {', '.join(known)}")


AS_IT_SAYS = NavigationSettings()


def parse_columns(text: str) -> MappingProxyType[str, str]:
    """{quantity: heading} of "depth_m=KP_DEPTH,heading_deg=Gyro"; a part with a comma in its heading is quoted.

    An empty text maps nothing.

    Raises:
        InputError: a part without an equals sign, a quantity that is not known or that is given twice.
    """
    mapped: dict[str, str] = {}
    for part in next(csv.reader([text]), ()):
        quantity, equals, heading = (piece.strip() for piece in part.partition("="))
        if not (equals and heading):
            raise InputError(f"--nav-columns: {part!r} is not a mapping; wanted as in --nav-columns depth_m=KP_DEPTH")
        if quantity not in QUANTITIES:
            raise InputError(f"--nav-columns: {quantity!r} is not known; wanted one of {', '.join(QUANTITIES)}")
        if quantity in mapped:
            raise InputError(f"--nav-columns gives {quantity} twice; delete one")
        mapped[quantity] = heading
    return MappingProxyType(mapped)


def parse_mount(text: str, frame: NavFrame | None = None) -> Mount:
    """The mount of "ROLL,PITCH,HEADING[,X,Y,Z]" [deg, m], in the signs of the vehicle's frame.

    Raises:
        InputError: not three or six numbers within 360 degrees and 100 m.
    """
    try:
        numbers = np.array([float(part) for part in text.split(",")])
    except ValueError:
        numbers = np.empty(0)
    if len(numbers) not in (3, 6) or not ((np.abs(numbers[:3]) <= 360).all() and (np.abs(numbers[3:]) <= 100).all()):
        raise InputError(
            f"--mount is {text!r}; wanted roll, pitch and heading of the sonar on the vehicle in degrees, and perhaps "
            "where it sits, X forward, Y starboard, Z down in meters (with --nav-frame flu Y port, Z up), as in "
            "--mount 0,-30,0,0.4,0,0.2"
        )
    return Mount.of(numbers[:3], numbers[3:] if len(numbers) == 6 else np.zeros(3), up=frame in UP_FRAMES)
