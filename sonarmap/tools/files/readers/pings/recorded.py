"""A line of a multibeam echo sounder as its file has it: by latitude, longitude and true North."""

from dataclasses import dataclass, replace

import numpy as np

from sonarmap.kernels.errors import InputError
from sonarmap.slam.pings.line import PingLine
from sonarmap.tools.files.geo.georeference import Georeference
from sonarmap.tools.files.readers.navigation.earth import rounded_origin

NO_DRAUGHT = "Depths are below the transducer; the file does not give its draught (--draught M)."
_AHEAD = np.array([1e-4, 0.0, 0.0])  # degrees of latitude, about 11 m: a step to the North


@dataclass(frozen=True, slots=True)
class RecordedLine:
    """Pings and soundings of one file, not yet placed in a map; frames of the pings are those of `PingLine`.

    Attributes:
        name: what to call it in messages and tables.
        echo_sounder: what recorded it, as the file says; "" if it does not.
        stamps: (P,) float64 [s, UTC], ascending, P >= 1.
        fixes: (P, 3) float64 latitude, longitude [deg, WGS84] and height [m] of the pings' frames. The height is Up, of
            the level from which the recording counts depths above the vertical reference; 0 where it does not say.
        attitudes: (P, 3) float64 [rad]: roll, starboard side down; pitch, bow up; heading, clockwise from true North.
        sensors: (P, 3) float64 [m], where the transducer was, in the pings' frames.
        pings: (N,) int64, ascending: the ping of each sounding.
        points: (N, 3) float64 [m], soundings that were not rejected, in the frames of their pings.
        beams: how many soundings the pings have in all, rejected ones counted.
        sound_speed: at the transducer [m/s], the median; None if the file does not say.
        notes: what the user should know of the file.
        below_water: whether depths count from the water, and not from the transducer.
    """

    name: str
    echo_sounder: str
    stamps: np.ndarray
    fixes: np.ndarray
    attitudes: np.ndarray
    sensors: np.ndarray
    pings: np.ndarray
    points: np.ndarray
    beams: int
    sound_speed: float | None
    notes: tuple[str, ...]
    below_water: bool = True

    @property
    def rejected(self) -> int:
        """How many soundings the recording rejects, or are none."""
        return self.beams - len(self.points)

    def immersed(self, draught: float) -> "RecordedLine":
        """The line with its transducer so deep below the water [m]. Raises InputError: the file says how deep it is."""
        if draught and self.below_water:
            raise InputError(f"{self.name} says how deep the transducer was; leave --draught out")
        return replace(self, fixes=self.fixes - [0.0, 0.0, draught])

    def origin(self) -> Georeference:
        """An origin for a map of this line: its first fix, rounded."""
        return rounded_origin(self.fixes, "fix", [])

    def placed(self, georeference: Georeference) -> PingLine:
        """The line in the frame of a map, headings by the North of the map's origin. Raises InputError: a fix more than
        200 km from the origin."""
        places = georeference.local(self.fixes)
        # meridians meet at the pole: the North of a place beside the origin is not the origin's
        ahead = georeference.local(self.fixes + _AHEAD) - places
        attitudes = self.attitudes.copy()
        attitudes[:, 2] += np.arctan2(ahead[:, 0], ahead[:, 1])
        return PingLine(self.name, self.stamps, places, attitudes, self.sensors, self.pings, self.points)
