"""What a line of pings holds, in a few numbers."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from sonarmap.slam.pings.cut import swath_width
from sonarmap.tools.files.readers.pings.line_file import read_line


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
