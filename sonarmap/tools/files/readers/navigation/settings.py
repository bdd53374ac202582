"""Settings for reading navigation: what the file itself does not say, and the sonar's mount on the vehicle."""

import csv
import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from types import MappingProxyType
from typing import Literal

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from sonarmap.kernels.errors import InputError
from sonarmap.spectral.scan import PosePrior
from sonarmap.tools.files.geo import DEGREE, EAST, Georeference, Projection, on_the_earth
from sonarmap.tools.files.readers.instruments import MIN_ROWS
from sonarmap.tools.files.readers.navigation.correction import Correction
from sonarmap.tools.files.readers.navigation.headings import QUANTITIES
from sonarmap.tools.files.time_scales import TIME_SCALES, TimeScale

NavFrame = Literal["frd", "ned", "flu", "enu"]
# frd and ned name one convention by its vehicle or its world frame; flu and enu name the other one
DOWN_FRAMES: tuple[NavFrame, ...] = ("frd", "ned")
UP_FRAMES: tuple[NavFrame, ...] = ("flu", "enu")
NAV_FRAMES = DOWN_FRAMES + UP_FRAMES
OF_TABLES = ("--time-scale", "--nav-columns", "--nav-crs", "--nav-frame", "--magnetic-declination")
OF_NMEA = ("--nmea-talker",)
HEADING_REFERENCES = ("true", "grid")
_MAX_OFFSET = 1e10  # [s], more than 300 years
_NOTHING: MappingProxyType[str, str] = MappingProxyType({})
_NO_SIGMAS: Mapping[str, float] = MappingProxyType({})
UNKNOWN_TILT = 0.2  # [rad], standard deviation of roll and pitch that were not measured
_MAX_MOUNT_TILT = 30.0  # [deg], of a mount on a vehicle without measured roll and pitch
_FRD_TO_FLU = np.array([1.0, -1.0, -1.0])  # forward, right, down to forward, left, up, and back
_FAR = 1.0  # [deg]: positions farther from the median are not of the survey
_CONSTANTS = 4  # most different positions that are none of the survey
_ROUNDED = 5  # decimals of the origin's degrees, about a meter


@dataclass(frozen=True, slots=True)
class Mount:
    T_vehicle_sensor: RigidTransform  # both with x forward, y left, z up [m]

    @classmethod
    def of(cls, angles: np.ndarray, lever: np.ndarray, up: bool) -> "Mount":
        """The mount with `angles` roll, pitch, heading (3,) [deg], applied in the order heading, pitch, roll, and the
        `lever` arm (3,) [m] from the vehicle's reference point to the sonar, both in axes forward, starboard, down, or,
        with `up`, forward, left, up."""
        signs = np.ones(3) if up else _FRD_TO_FLU
        R_vehicle_sensor = Rotation.from_euler("ZYX", (angles * signs)[::-1], degrees=True)
        return cls(RigidTransform.from_components(lever * signs, R_vehicle_sensor))

    @property
    def tilt(self) -> float:
        """Angle between the vehicle's vertical axis and the sonar's [rad]."""
        up = self.T_vehicle_sensor.rotation.apply([0.0, 0.0, 1.0])
        return float(np.arctan2(np.hypot(up[0], up[1]), up[2]))

    def of_sensor(self, vehicle: PosePrior) -> PosePrior:
        """The prior of the sonar: T_world_sensor = T_world_vehicle * T_vehicle_sensor. Errors of the rotation add to
        those of the position at the end of the lever arm; without a heading the horizontal position is the vehicle's,
        with the arm's length added to its error."""
        if vehicle.knows_heading and not vehicle.knows_attitude and np.degrees(self.tilt) > _MAX_MOUNT_TILT:
            raise InputError(f"mounted at a tilt of {np.degrees(self.tilt):.0f} degrees: add columns of roll and pitch")
        T_world_sensor = vehicle.T_world_sensor * self.T_vehicle_sensor
        R, arm = vehicle.T_world_sensor.rotation, self.T_vehicle_sensor.translation
        lever = R.apply(arm)
        flat, length = float(np.hypot(lever[0], lever[1])), float(np.linalg.norm(lever))
        tilt = float(vehicle.sigmas[:2].max()) if vehicle.knows_attitude else UNKNOWN_TILT
        sigmas, place = vehicle.sigmas.copy(), T_world_sensor.translation.copy()
        sigmas[3:5] = np.hypot(sigmas[3:5], abs(float(lever[2])) * tilt)
        sigmas[5] = np.hypot(sigmas[5], flat * tilt)
        off = flat * min(float(vehicle.sigmas[2]), 1.0) if vehicle.knows_heading else length
        sigmas[3:5] = np.hypot(sigmas[3:5], off)
        if not vehicle.knows_heading:
            place[:2] = vehicle.T_world_sensor.translation[:2]
        sigmas[:2] = sigmas[:2].max()  # the vehicle's pitch is the roll of a sonar that looks sideways
        return PosePrior(RigidTransform.from_components(place, T_world_sensor.rotation), sigmas)


@dataclass(frozen=True, slots=True)
class NavigationSettings:
    """How to read navigation; the defaults suit a file with the columns and signs of docs/navigation.md."""

    # {quantity: the heading of its column}, for headings that are not recognized
    columns: MappingProxyType[str, str] = field(default_factory=lambda: _NOTHING)
    time_scale: TimeScale | None = None  # of times without a zone; None for UTC, or GPS time with GPS weeks
    offset: float = 0.0  # added to the file's times [s]
    crs: str | None = None  # of eastings and northings, as EPSG:32632
    origin: Georeference | None = None  # of the map's frame; None for the first fix, if the file has geographic ones
    heading_reference: str = "true"  # "true" or "grid" (the North of `crs`, or of the UTM zone)
    declination: float | None = None  # added to magnetic headings [deg], East positive; None if they are not magnetic
    # convention of roll, pitch, yaw and of x, y, z, one of NAV_FRAMES; None for compass headings and pitch nose up,
    # where a yaw or z is refused
    frame: NavFrame | None = None
    mount: Mount | None = None  # of the sonar on the vehicle
    correction: Correction | None = None  # of the measured poses of the sonar
    # {column of `tools.files.readers.instruments.COLUMNS`: standard deviation [deg, m]}, for columns without one
    sigmas: Mapping[str, float] = field(default_factory=lambda: _NO_SIGMAS)
    fastest: float = math.inf  # largest speed of the vehicle [m/s]; rows that need a higher one are left out
    talkers: tuple[str, ...] = ()  # of the NMEA sentences to use, as "GP"; empty for all
    are_shared: bool = False  # whether they are for several files; then a setting may be unused by some of them

    def __post_init__(self) -> None:
        _require_one_of("--time-scale", self.time_scale, TIME_SCALES)
        _require_one_of("--nav-frame", self.frame, NAV_FRAMES)
        if self.heading_reference == "magnetic":
            raise InputError("--heading-reference magnetic: give --magnetic-declination DEG (East positive) instead")
        _require_one_of("--heading-reference", self.heading_reference, HEADING_REFERENCES)
        if not abs(self.offset) <= _MAX_OFFSET:
            raise InputError(f"--nav-offset is {self.offset:g}; wanted seconds within {_MAX_OFFSET:g}")
        if self.declination is None:
            return
        if not abs(self.declination) <= 180:
            raise InputError(f"--magnetic-declination is {self.declination:g}; wanted degrees within 180")
        if self.heading_reference == "grid":
            raise InputError("--magnetic-declination is not for grid headings; give only one of both")

    @property
    def points_up(self) -> bool:
        """Whether the axes are forward, left, up in East, North, Up: pitch nose down, yaw from East to North."""
        return self.frame in UP_FRAMES

    def refuse_unused(
        self, path: Path, kind: str, unused: Sequence[str] = OF_TABLES, frames: tuple[NavFrame, ...] = NAV_FRAMES
    ) -> None:
        """Refuse the options `unused`, and frames other than `frames`, which have no effect on a file of this kind.
        `kind`: in words, for the message."""
        for option, given in (
            ("--time-scale", self.time_scale not in (None, "utc")),
            ("--nav-columns", bool(self.columns)),
            ("--nav-crs", self.crs is not None),
            ("--nav-frame", self.frame not in (None, *frames)),
            ("--magnetic-declination", self.declination is not None),
            ("--nmea-talker", bool(self.talkers)),
        ):
            if given and option in unused and not self.are_shared:
                raise InputError(f"{path} {kind}, for which {option} has no effect; leave it out")


def _require_one_of(option: str, value: str | None, known: tuple[str, ...]) -> None:
    if value is not None and value not in known:
        raise InputError(f"{option} is {value!r}; wanted one of {', '.join(known)}")


AS_IT_SAYS = NavigationSettings()


def parse_columns(text: str) -> MappingProxyType[str, str]:
    """Parse "depth_m=KP_DEPTH,heading_deg=Gyro" to {quantity: heading}; a part with a comma in its heading is quoted;
    an empty text gives an empty mapping."""
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


def parse_talkers(text: str) -> tuple[str, ...]:
    """Parse "GP,HE" to talkers."""
    talkers = tuple(part.strip().upper() for part in text.split(","))
    if not all(re.fullmatch("[A-Z]{2}", talker) for talker in talkers):
        raise InputError(f"--nmea-talker is {text!r}; wanted the two letters behind the $, as in --nmea-talker GP,HE")
    return talkers


def parse_mount(text: str, frame: NavFrame | None = None) -> Mount:
    """Parse "ROLL,PITCH,HEADING[,X,Y,Z]" [deg, m], with the signs of `frame`, to a mount."""
    try:
        numbers = np.array([float(part) for part in text.split(",")])
    except ValueError:
        numbers = np.empty(0)
    if len(numbers) not in (3, 6) or not ((np.abs(numbers[:3]) <= 360).all() and (np.abs(numbers[3:]) <= 100).all()):
        raise InputError(
            f"--mount is {text!r}; wanted roll, pitch, heading, perhaps x, y, z, as in --mount 0,-30,0,0.4,0,0.2"
        )
    return Mount.of(numbers[:3], numbers[3:] if len(numbers) == 6 else np.zeros(3), up=frame in UP_FRAMES)


def local_places(
    values: np.ndarray, are_degrees: bool, settings: NavigationSettings, notes: list[str]
) -> tuple[np.ndarray, Georeference]:
    """The rows with x East and y North of the map's origin, and the georeference of the origin. `values`: (n, 6) in the
    order of COLUMNS, with longitude and latitude [deg] (`are_degrees`) or easting and northing [m] for x and y."""
    values = values.copy()
    known = np.asarray(np.isfinite(values[:, 3:5]).all(axis=1))
    known[known] = ~_without_fix(values[known, 3:5], are_degrees, notes)
    values[~known, 3:5] = np.nan
    if not known.any():
        raise InputError("no row has a position; wanted a latitude and longitude, or an easting and northing")
    # East and North at the vehicle's depth; at the surface where no depth is known
    heights = -np.nan_to_num(values[known, 5])
    geodetic = np.column_stack([values[known, 4], values[known, 3], heights])
    if not are_degrees:
        geodetic = on_the_earth(np.column_stack([values[known, 3:5], heights]), settings.crs, "--nav-crs")
    origin = settings.origin
    if origin is None:
        origin = rounded_origin(geodetic, "fix", notes)
    if origin.heading != EAST:
        raise InputError("--origin-heading has no effect where navigation places the map; leave it out")
    geodetic[:, 2] += origin.height
    values[known, 3:5] = origin.local(geodetic)[:, :2]
    return values, origin


def _without_fix(places: np.ndarray, are_degrees: bool, notes: list[str]) -> np.ndarray:
    """(n,) bool: positions [deg or m] at 0, 0, or at few places that are far from all others."""
    unset = (places == 0).all(axis=1) & are_degrees
    if unset.any():
        notes.append(f"{unset.sum()} rows are at 0, 0, as without a fix; these positions are left out")
    if (~unset).sum() < MIN_ROWS:
        return unset
    off = places - np.median(places[~unset], axis=0)
    off = (off + 180) % 360 - 180 if are_degrees else off / DEGREE
    far = (np.abs(off) > _FAR).any(axis=1) & ~unset
    constants, counts = np.unique(places[far], axis=0, return_counts=True)
    if len(constants) > _CONSTANTS or far.mean() > 0.5:
        return unset
    for (x, y), count in zip(constants.tolist(), counts.tolist(), strict=True):
        notes.append(f"{count} rows are at {y:g}, {x:g}, as without a fix; these positions are left out")
    return unset | far


def rounded_origin(geodetic: np.ndarray, what: str, notes: list[str]) -> Georeference:
    """An origin at the first of (n, 3) latitudes, longitudes [deg] and heights, rounded; a note calls it a `what`."""
    latitude, longitude = (round(float(angle), _ROUNDED) for angle in geodetic[0, :2])
    notes.append(f"the map's origin is the first {what}, rounded: {latitude:.5f}, {longitude:.5f}")
    return Georeference(latitude, longitude)


def grid_of(settings: NavigationSettings, georeference: Georeference | None) -> Projection:
    """The projection whose grid North headings count from."""
    if georeference is None:
        raise InputError("--heading-reference grid needs a position; give --origin, or geographic navigation")
    return Projection.of(georeference, settings.crs)


def by_the_maps_north(
    priors: Sequence[PosePrior | None], georeference: Georeference, grid: Projection | None
) -> list[PosePrior | None]:
    """Turn headings that count from the North at each prior's position to the North at the map's origin. A prior
    without a position is taken to be at the origin. `grid`: projection whose North headings count from; None for true
    North."""
    changed = list(priors)
    headed = [(k, prior) for k, prior in enumerate(priors) if prior is not None and prior.knows_heading]
    if not headed:
        return changed
    places = np.array([prior.T_world_sensor.translation * prior.knows_position for _, prior in headed])
    geodetic = georeference.geodetic(places)
    # true North lies to the right of grid North by the convergence
    turned = np.zeros(len(headed)) if grid is None else grid.convergence(geodetic)
    ahead = georeference.local(geodetic + np.array([1e-4, 0.0, 0.0])) - georeference.local(geodetic)
    turned = turned + np.degrees(np.arctan2(ahead[:, 0], ahead[:, 1]))
    for (k, prior), turn in zip(headed, turned.tolist(), strict=True):
        T = prior.T_world_sensor
        R = Rotation.from_euler("Z", -turn, degrees=True) * T.rotation
        changed[k] = replace(prior, T_world_sensor=RigidTransform.from_components(T.translation, R))
    return changed
