"""Read a file of a multibeam echo sounder as a line, and cut the line into patches: scans with priors from the line's
navigation. A new format is a file in pings/ and a row of FORMATS."""

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from scipy.spatial.transform import RigidTransform

from sonarmap.kernels.errors import InputError
from sonarmap.slam.motion.odometry import Odometry
from sonarmap.slam.pings.biases import Biases, corrected
from sonarmap.slam.pings.pieces import cut, swath_width
from sonarmap.spectral.scan import PosePrior, Scan
from sonarmap.tools.files.geo import DEFAULT_VERTICAL, ELLIPSOID, Georeference
from sonarmap.tools.files.readers.clouds.cloud import Cloud, PingPatch
from sonarmap.tools.files.readers.instruments import COLUMNS
from sonarmap.tools.files.readers.navigation.settings import by_the_maps_north, rounded_origin
from sonarmap.tools.files.readers.pings.gsf import read_gsf
from sonarmap.tools.files.readers.pings.kmall import read_kmall
from sonarmap.tools.files.readers.pings.kongsberg import read_all
from sonarmap.tools.files.readers.pings.recorded import NO_DRAUGHT, RecordedLine
from sonarmap.tools.files.readers.pings.xtf import read_xtf
from sonarmap.tools.files.user_file import Kind, naming, require_file, require_kind

# Usual errors of a motion sensor, a gyrocompass, DGNSS and the water level, by COLUMNS.
_SIGMAS: Mapping[str, float] = dict(zip(COLUMNS, (0.3, 0.3, 1.0, 1.5, 1.5, 0.2), strict=True))
_MAX_DRAUGHT = 100.0  # [m]
_DEPTH_ERROR = 0.003  # share of the depth, from the sound speed
_DRIFT = 0.01  # of the navigation within a line, share of the distance
_TURN_DRIFT = float(np.radians(10.0) / 3600)  # of its heading [rad/s]


@dataclass(frozen=True, slots=True)
class Format(Kind):
    """A file format of multibeam echo sounders."""

    read: Callable[[Path], RecordedLine]


_ALL = Format("a Kongsberg .all file", rb"(?s)(.{2}.\x00|\x00.{3})\x02[0-9A-Za-z\xe1-\xe5]", read_all)
FORMATS = {
    ".gsf": Format("a GSF file", rb"(?s).{4}[\x00\x80]\x00\x00\x01(.{4})?GSF-", read_gsf),
    ".xtf": Format("an XTF file", rb"(?s)\x7b[^\s\"'{}\]]", read_xtf),
    # .wcd files have the water column of a .all file, .mb* files are written by MB-System
    **dict.fromkeys((".all", ".wcd", ".mb56", ".mb57", ".mb58", ".mb59"), _ALL),
    ".kmall": Format("a Kongsberg .kmall file", rb"(?s).{4}#[A-Z]{3}", read_kmall),
}


@dataclass(frozen=True, slots=True)
class LineReading:
    """How lines are read and cut into scans."""

    patch: float | None = None  # length of a patch along the track [m]; None for half the swath's width
    biases: Biases = field(default_factory=Biases)  # of the line's instruments, which are corrected
    draught: float = 0.0  # depth of the transducer below the water surface [m], for files without it
    all_soundings: bool = False  # whether soundings that the files flag as rejected are kept
    heights: str = DEFAULT_VERTICAL  # their vertical reference: as recorded, or "ellipsoid" where the files have it

    def __post_init__(self) -> None:
        if self.patch is not None and not 0 < self.patch < np.inf:
            raise InputError(f"a patch of {self.patch:g} m: wanted a length above 0")
        if not 0 <= self.draught < _MAX_DRAUGHT:
            raise InputError(f"a draught of {self.draught:g} m: wanted 0 to {_MAX_DRAUGHT:g} m")
        if self.heights not in (DEFAULT_VERTICAL, ELLIPSOID):
            raise InputError(f"heights above {self.heights!r}: wanted {DEFAULT_VERTICAL} or {ELLIPSOID}")


AS_LINES = LineReading()


def read_line(path: Path, notes: list[str], reading: LineReading = AS_LINES) -> RecordedLine:
    """The line of a file; its notes are added to `notes`, after the file's name."""
    require_file(path)
    with naming(path):
        return _line(path, notes, reading)


def _line(path: Path, notes: list[str], reading: LineReading) -> RecordedLine:
    known = FORMATS.get(path.suffix.lower())
    if known is None:
        raise InputError(f"unknown format {path.suffix or '(no suffix)'!r}; known are {', '.join(FORMATS)}")
    require_kind(path, FORMATS)
    try:
        with np.errstate(invalid="ignore", over="ignore"):  # in damaged files; `assembled` leaves them out
            line = known.read(path).selected(reading.all_soundings).immersed(reading.draught)
    except MemoryError as error:
        raise InputError("too large for this machine's memory; split it") from error
    if reading.heights == ELLIPSOID:
        line = line.above_ellipsoid()
    notes += [f"{path.name}: {note}" for note in line.notes]
    return line


@dataclass(frozen=True, slots=True)
class LineOverview:
    """Overview of a line for `sonarmap inspect`."""

    file: str  # its name
    echo_sounder: str  # as named in the file; "" if it is not
    pings: int  # number of pings
    beams: int  # number of soundings, including rejected ones
    rejected: int  # number of rejected soundings
    seconds: float  # from the first ping to the last [s]
    length: float  # of the track [m]
    depth: tuple[float, float, float]  # 5th, 50th and 95th percentile, below the level from which depths count [m]
    swath: float  # median width [m]
    roll: tuple[float, float]  # mean and standard deviation [deg]
    pitch: tuple[float, float]  # mean and standard deviation [deg]
    heading: tuple[float, float]  # circular mean and standard deviation [deg]

    @property
    def speed(self) -> float:
        """Mean speed [m/s]; 0 if all pings have one stamp."""
        return self.length / self.seconds if self.seconds > 0 else 0.0


def line_overview(path: Path, reading: LineReading = AS_LINES) -> LineOverview:
    recorded = read_line(path, [], reading)
    line = recorded.placed(recorded.origin())
    low, middle, high = np.percentile(-line.points[:, 2], [5, 50, 95]).tolist()
    roll, pitch, heading = line.attitudes.T
    mean = float(np.angle(np.exp(1j * heading).mean()))
    off = np.angle(np.exp(1j * (heading - mean)))
    swings = [(roll.mean(), roll.std()), (pitch.mean(), pitch.std()), (mean % (2 * np.pi), off.std())]
    rolls, pitches, headings = [(a, b) for a, b in np.degrees(swings).tolist()]
    return LineOverview(
        path.name, recorded.echo_sounder, len(line.stamps), recorded.beams, recorded.rejected,
        float(np.ptp(line.stamps)), line.length, (low, middle, high), swath_width(line), rolls, pitches, headings,
    )  # fmt: skip


def line_clouds(path: Path, notes: list[str], reading: LineReading) -> Iterator[Cloud]:
    """The patches of a line's file, each in a level frame at the transducer in its middle. An InputError does not name
    the file."""
    recorded = _line(path, notes, reading)
    origin, below = recorded.origin(), recorded.below_water or reading.draught > 0
    if not below:
        notes.append(f"{path.name}: {NO_DRAUGHT}")
    patches = cut(corrected(recorded.placed(origin), reading.biases), reading.patch)
    geodetic = origin.geodetic(np.stack([patch.T_world_piece.translation for patch in patches]))
    for patch, place in zip(patches, geodetic.tolist(), strict=True):
        points, viewpoints, R = patch.points, patch.viewpoints, patch.T_world_piece.rotation
        depth = float(np.median(viewpoints[:, 2] - points[:, 2]))
        placed_by = PingPatch(path, patch.middle, len(patches), depth, tuple(place), R, below, reading.heights)
        yield Cloud(points, stamp=patch.stamp, viewpoints=viewpoints, patch=placed_by, sound_speed=recorded.sound_speed)


def placed(
    scans: Sequence[Scan],
    patches: Mapping[int, PingPatch],
    origin: Georeference | None = None,
    sigmas: Mapping[str, float] | None = None,
) -> tuple[tuple[Scan, ...], Georeference]:
    """Scans with priors for their patches in the world at `origin`, or at the first patch, and its georeference. The
    navigation's error is common to all patches of a line: their position sigmas are multiplied by the square root of
    their number, so that together they weigh as one fix. `patches`: by index of their scans, at least one. `sigmas`:
    standard deviations [deg, m] by COLUMNS; None for those of usual instruments."""
    numbers, known = list(patches), list(patches.values())
    geodetic = np.array([patch.geodetic for patch in known])
    here = origin or rounded_origin(geodetic, "patch", [])
    if known[0].vertical == ELLIPSOID:
        if here.vertical not in (DEFAULT_VERTICAL, ELLIPSOID):
            raise InputError(f"--vertical {here.vertical} contradicts --heights ellipsoid; leave one of them out")
        here = replace(here, vertical=ELLIPSOID)
    places = here.local(geodetic)
    priors: list[PosePrior | None] = []
    for patch, place in zip(known, places, strict=True):
        deviations = np.array([(sigmas or _SIGMAS)[column] for column in COLUMNS])
        deviations[:3] = np.radians(deviations[:3])
        if sigmas is None:
            deviations[5] = np.hypot(deviations[5], _DEPTH_ERROR * patch.depth)
        deviations[3:] *= np.sqrt(patch.count)
        T = RigidTransform.from_components(place, patch.R_north_patch)
        priors.append(PosePrior(T, deviations))
    turned = dict(zip(numbers, by_the_maps_north(priors, here, None), strict=True))
    return tuple(replace(scan, prior=turned[k]) if k in turned else scan for k, scan in enumerate(scans)), here


def as_survey(
    scans: Sequence[Scan], patches: Mapping[int, PingPatch], odometry: Odometry | None = None
) -> tuple[Sequence[Scan], Odometry | None]:
    """Scans with priors for patches, in the world at the first patch, and the odometry, by default `way_within`."""
    if not patches:
        return scans, odometry
    there, _ = placed(scans, patches)
    return there, odometry or way_within(there, patches)


def way_within(scans: Sequence[Scan], patches: Collection[int]) -> Odometry | None:
    """Odometry from patch to patch by the lines' navigation; None if no patch has a complete prior. Patches share no
    pings, so that only the navigation relates them along a line."""
    priors = {k: prior for k in patches if (prior := scans[k].prior) is not None and prior.is_complete}
    if not priors:
        return None
    T = RigidTransform.concatenate([prior.T_world_sensor for prior in priors.values()])
    stamps = np.array([scans[k].stamp for k in priors])
    return Odometry(np.array(list(priors)), T, stamps, _DRIFT, _TURN_DRIFT, alone=True)
