"""One file of a multibeam echo sounder to its line, and a line to scans: it is cut into patches, which its navigation
places. A new format is a file in pings/ and a row of FORMATS."""

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
from sonarmap.tools.files.geo import Georeference
from sonarmap.tools.files.readers.clouds.cloud import Cloud, PingPatch
from sonarmap.tools.files.readers.instruments import COLUMNS
from sonarmap.tools.files.readers.navigation.settings import by_the_maps_north, rounded_origin
from sonarmap.tools.files.readers.pings.gsf import read_gsf
from sonarmap.tools.files.readers.pings.kongsberg import read_all
from sonarmap.tools.files.readers.pings.recorded import NO_DRAUGHT, RecordedLine
from sonarmap.tools.files.readers.pings.xtf import read_xtf
from sonarmap.tools.files.user_file import Kind, naming, require_file, require_kind

# Of a motion sensor, a gyrocompass, DGNSS, and a water level that is known to decimeters, as COLUMNS have them.
_SIGMAS: Mapping[str, float] = dict(zip(COLUMNS, (0.3, 0.3, 1.0, 1.5, 1.5, 0.2), strict=True))
_DEEPEST = 100.0  # [m], of a ship's draught
_OF_DEPTH = 0.003  # errors of sound speed are a share of the depth
# The way within a line, as its navigation has it: share of the way, and rotation [rad/s].
_DRIFT, _TURN_DRIFT = 0.01, float(np.radians(10.0) / 3600)


@dataclass(frozen=True, slots=True)
class Format(Kind):
    """A format of lines of pings."""

    read: Callable[[Path], RecordedLine]


def _refuse_kmall(path: Path) -> RecordedLine:
    raise InputError("no library that is kept up reads Kongsberg's .kmall; convert it to GSF, and give that")


_ALL = Format("a Kongsberg .all file", rb"(?s)(.{2}.\x00|\x00.{3})\x02[0-9A-Za-z\xe1-\xe5]", read_all)
FORMATS = {
    ".gsf": Format("a GSF file", rb"(?s).{4}[\x00\x80]\x00\x00\x01(.{4})?GSF-", read_gsf),
    ".xtf": Format("an XTF file", rb"(?s)\x7b[^\s\"'{}\]]", read_xtf),
    # the second is its water column, the others are MB-System's names of the same datagrams
    **dict.fromkeys((".all", ".wcd", ".mb56", ".mb57", ".mb58", ".mb59"), _ALL),
    ".kmall": Format("a Kongsberg .kmall file", rb"(?s).{4}#[A-Z]{3}", _refuse_kmall),
}


def read_line(path: Path, notes: list[str]) -> RecordedLine:
    """The line of a file; its notes, with its name, are added to the list."""
    require_file(path)
    with naming(path):
        return _line(path, notes)


def _line(path: Path, notes: list[str]) -> RecordedLine:
    known = FORMATS.get(path.suffix.lower())
    if known is None:
        raise InputError(f"unknown format {path.suffix or '(no suffix)'!r}; known are {', '.join(FORMATS)}")
    require_kind(path, FORMATS)
    try:
        with np.errstate(invalid="ignore", over="ignore"):  # numbers of damaged files, which are sorted out later
            line = known.read(path)
    except MemoryError as error:
        raise InputError("too large for this machine's memory; split it") from error
    notes += [f"{path.name}: {note}" for note in line.notes]
    return line


@dataclass(frozen=True, slots=True)
class LineOverview:
    """What `sonarmap inspect` says of a line."""

    file: str  # its name
    echo_sounder: str  # as the file says; "" if it does not
    pings: int  # how many
    beams: int  # soundings in all, rejected ones counted
    rejected: int  # how many of these
    seconds: float  # from the first ping to the last [s]
    length: float  # of the track [m]
    depth: tuple[float, float, float]  # 5 %, median and 95 % below the level from which the file counts depths [m]
    swath: float  # its median width [m]
    roll: tuple[float, float]  # mean and standard deviation [deg], as of pitch and heading
    pitch: tuple[float, float]
    heading: tuple[float, float]  # about its mean direction

    @property
    def speed(self) -> float:
        """Mean [m/s]; 0 of one ping."""
        return self.length / self.seconds if self.seconds > 0 else 0.0


def line_overview(path: Path) -> LineOverview:
    recorded = read_line(path, [])
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


@dataclass(frozen=True, slots=True)
class LineReading:
    """How lines become scans."""

    patch: float | None = None  # length of a patch along the track [m]; None for half the swath's width
    biases: Biases = field(default_factory=Biases)  # of the line's instruments, which are taken out
    draught: float = 0.0  # how deep the transducer was below the water [m], where the files do not say

    def __post_init__(self) -> None:
        if self.patch is not None and not 0 < self.patch < np.inf:
            raise InputError(f"a patch of {self.patch:g} m: wanted a length above 0")
        if not 0 <= self.draught < _DEEPEST:
            raise InputError(f"a draught of {self.draught:g} m: wanted 0 to {_DEEPEST:g} m")


AS_LINES = LineReading()


def line_clouds(path: Path, notes: list[str], reading: LineReading) -> Iterator[Cloud]:
    """The patches of a line's file, each level about the transducer in its middle. Whoever catches an InputError names
    the file."""
    recorded = _line(path, notes).immersed(reading.draught)
    origin, below = recorded.origin(), recorded.below_water or reading.draught > 0
    if not below:
        notes.append(f"{path.name}: {NO_DRAUGHT}")
    patches = cut(corrected(recorded.placed(origin), reading.biases), reading.patch)
    geodetic = origin.geodetic(np.stack([patch.T_world_piece.translation for patch in patches]))
    for patch, place in zip(patches, geodetic.tolist(), strict=True):
        points, viewpoints, R = patch.points, patch.viewpoints, patch.T_world_piece.rotation
        depth = float(np.median(viewpoints[:, 2] - points[:, 2]))
        placed_by = PingPatch(path, patch.middle, len(patches), depth, tuple(place), R, below)
        yield Cloud(points, stamp=patch.stamp, viewpoints=viewpoints, patch=placed_by, sound_speed=recorded.sound_speed)


def placed(
    scans: Sequence[Scan],
    patches: Mapping[int, PingPatch],
    origin: Georeference | None = None,
    sigmas: Mapping[str, float] | None = None,
) -> tuple[tuple[Scan, ...], Georeference]:
    """Scans of lines in the world of an origin, or of the first patch, others as they were; and this world's
    georeference. Along a line the navigation's error is one: all of its patches together place it no better than one
    fix does, and each has as much a larger sigma. `patches`: by scan, at least one. `sigmas`: standard deviations [deg,
    m] by column of COLUMNS; None for those of usual instruments."""
    numbers, known = list(patches), list(patches.values())
    geodetic = np.array([patch.geodetic for patch in known])
    here = origin or rounded_origin(geodetic, "patch", [])
    places = here.local(geodetic)
    priors: list[PosePrior | None] = []
    for patch, place in zip(known, places, strict=True):
        deviations = np.array([(sigmas or _SIGMAS)[column] for column in COLUMNS])
        deviations[:3] = np.radians(deviations[:3])
        if sigmas is None:
            deviations[5] = np.hypot(deviations[5], _OF_DEPTH * patch.depth)
        deviations[3:] *= np.sqrt(patch.count)
        T = RigidTransform.from_components(place, patch.R_north_patch)
        priors.append(PosePrior(T, deviations))
    turned = dict(zip(numbers, by_the_maps_north(priors, here, None), strict=True))
    return tuple(replace(scan, prior=turned[k]) if k in turned else scan for k, scan in enumerate(scans)), here


def as_survey(
    scans: Sequence[Scan], patches: Mapping[int, PingPatch], odometry: Odometry | None = None
) -> tuple[Sequence[Scan], Odometry | None]:
    """Scans, those of lines placed about the first of these, and the way within lines where no other is given."""
    if not patches:
        return scans, odometry
    there, _ = placed(scans, patches)
    return there, odometry or way_within(there, patches)


def way_within(scans: Sequence[Scan], patches: Collection[int]) -> Odometry | None:
    """The way from patch to patch, as the lines' navigation has it; None where none of these scans is placed by it.
    Patches share no pings, so that nothing but it tells how they lie to each other along a line."""
    priors = {k: prior for k in patches if (prior := scans[k].prior) is not None and prior.is_complete}
    if not priors:
        return None
    T = RigidTransform.concatenate([prior.T_world_sensor for prior in priors.values()])
    stamps = np.array([scans[k].stamp for k in priors])
    return Odometry(np.array(list(priors)), T, stamps, _DRIFT, _TURN_DRIFT, alone=True)
