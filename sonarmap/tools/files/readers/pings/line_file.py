"""One file of a multibeam echo sounder to its line. A new format is a file in pings/ and a row of FORMATS."""

import re
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from sonarmap.kernels.errors import InputError
from sonarmap.slam.pings.pieces import swath_width
from sonarmap.tools.files.readers.pings.gsf import read_gsf
from sonarmap.tools.files.readers.pings.kongsberg import read_all
from sonarmap.tools.files.readers.pings.recorded import RecordedLine
from sonarmap.tools.files.readers.pings.xtf import read_xtf
from sonarmap.tools.files.user_file import naming, require_file, unreadable

_HEAD = 64  # bytes that are looked at to recognize a format


@dataclass(frozen=True, slots=True)
class Format:
    """A format of lines of pings."""

    kind: str  # what its files are, in words
    start: bytes  # a regular expression for the first bytes of its files
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
SUFFIXES = tuple(FORMATS)


def read_line(path: Path, notes: list[str]) -> RecordedLine:
    """The line of a file; its notes, with its name, are added to the list.

    Raises:
        InputError: naming the file: it is not what its suffix says, cannot be read, or holds no ping with soundings.
    """
    with naming(path):
        known = FORMATS.get(path.suffix.lower())
        if known is None:
            raise InputError(f"unknown format {path.suffix or '(no suffix)'!r}; known are {', '.join(SUFFIXES)}")
        _check_start(path, known)
        try:
            with np.errstate(invalid="ignore", over="ignore"):  # numbers of damaged files, which are sorted out later
                line = known.read(path)
        except MemoryError as error:
            raise InputError("too large for this machine's memory; split it") from error
    notes += [f"{path.name}: {note}" for note in line.notes]
    return line


def _check_start(path: Path, expected: Format) -> None:
    require_file(path)
    with unreadable(), path.open("rb") as file:
        head = file.read(_HEAD)
    if not head:
        raise InputError("the file is empty (0 bytes); write or copy it again")
    if re.match(expected.start, head):
        return
    for suffix, known in FORMATS.items():
        if re.match(known.start, head):
            raise InputError(f"it holds {known.kind}, not {expected.kind}; rename it to {suffix} if that is what it is")
    raise InputError(f"it does not begin as {expected.kind} does; write or copy it again")


@dataclass(frozen=True, slots=True)
class LineOverview:
    """One line.

    Attributes:
        file: its name.
        echo_sounder: as the file says; "" if it does not.
        pings: how many.
        beams: soundings in all, rejected ones counted.
        rejected: how many of these.
        seconds: from the first ping to the last [s].
        length: of the track [m].
        depth: 5 %, median and 95 % of the soundings' depths below the level from which the file counts them [m].
        swath: its median width [m].
        roll, pitch, heading: mean and standard deviation [deg], of the heading about its mean direction.
    """

    file: str
    echo_sounder: str
    pings: int
    beams: int
    rejected: int
    seconds: float
    length: float
    depth: tuple[float, float, float]
    swath: float
    roll: tuple[float, float]
    pitch: tuple[float, float]
    heading: tuple[float, float]

    @property
    def speed(self) -> float:
        """Mean [m/s]; 0 of one ping."""
        return self.length / self.seconds if self.seconds > 0 else 0.0


def line_overview(path: Path) -> LineOverview:
    """Of a file. Raises InputError: it cannot be read."""
    recorded = read_line(path, [])
    line = recorded.placed(recorded.origin())
    low, middle, high = np.percentile(-line.points[:, 2], [5, 50, 95]).tolist()
    roll, pitch, heading = line.attitudes.T
    mean = float(np.angle(np.exp(1j * heading).mean()))
    off = np.angle(np.exp(1j * (heading - mean)))
    swings = [(roll.mean(), roll.std()), (pitch.mean(), pitch.std()), (mean % (2 * np.pi), off.std())]
    in_degrees = [(a, b) for a, b in np.degrees(swings).tolist()]
    return LineOverview(
        file=path.name,
        echo_sounder=recorded.echo_sounder,
        pings=len(line.stamps),
        beams=recorded.beams,
        rejected=recorded.rejected,
        seconds=float(np.ptp(line.stamps)),
        length=line.length,
        depth=(low, middle, high),
        swath=swath_width(line),
        roll=in_degrees[0],
        pitch=in_degrees[1],
        heading=in_degrees[2],
    )
