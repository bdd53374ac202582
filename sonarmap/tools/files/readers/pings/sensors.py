"""Position and motion sensors of a Kongsberg file, at the times of its pings."""

from collections import defaultdict
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from sonarmap.kernels.counted import counted
from sonarmap.tools.files.readers.pings.recorded import between

# Ranks of a sensor: the sounder used it for depths; only its velocities, at a higher rate; not at all.
USED, VELOCITIES, UNUSED = range(3)
_GAPS = {"position": 10.0, "attitude": 1.0}  # [s], longest gaps that are interpolated
_BEYOND = {"position": 2.0, "attitude": 1.0}  # [s], extrapolation: a file may begin with any datagram
_LEAP, _FASTEST = 50.0, 40.0  # [m], [m/s] times the time between: a position farther from both neighbors is wrong
_DEGREE = 111_320.0  # meters of latitude

# Rank, datagram type, number. All used sensors of a type have the number 0 here, as the echo sounder may have changed
# between them.
_Source = tuple[int, str, int]


@dataclass(frozen=True, slots=True)
class Sensors:
    """Readings of all sensors: (n, 6) rows of positions: stamp, latitude, longitude [deg], velocity North and East
    [m/s], NaN if unknown, and the number of the sensor; (n, 4) of motions: stamp, roll, pitch [deg], number."""

    positions: dict[_Source, list[np.ndarray]] = field(default_factory=lambda: defaultdict(list))
    motions: dict[_Source, list[np.ndarray]] = field(default_factory=lambda: defaultdict(list))

    def add_position(
        self, rank: int, kind: str, number: int, stamp: float, fix: tuple[float, float], speed: float, course: float
    ) -> None:
        """Add a position of latitude and longitude [deg]; `speed` [m/s] and `course` [deg] over ground may be NaN."""
        if np.isfinite(stamp) and abs(fix[0]) <= 90 and abs(fix[1]) <= 180:
            angle = np.radians(course)
            row = [stamp, *fix, speed * np.cos(angle), speed * np.sin(angle), number]
            self.positions[rank, kind, number if rank else 0].append(np.array([row]))

    def add_motions(self, rank: int, kind: str, number: int, rows: np.ndarray) -> None:
        """Add (n, 3) rows of stamp, roll and pitch [deg]."""
        rows = rows[np.isfinite(rows).all(axis=1)]
        if len(rows):
            numbered = np.column_stack([rows, np.full(len(rows), number)])
            self.motions[rank, kind, number if rank else 0].append(numbered)

    def places(self, stamps: np.ndarray) -> tuple[np.ndarray, int, list[str]]:
        """(P, 2) latitudes and longitudes [deg], NaN if unknown; the number of the last position's sensor; notes."""
        if not self.positions:
            return np.full((len(stamps), 2), np.nan), 0, []
        (best, rows), notes = self._ordered(self.positions)[0], list[str]()
        if best[0] != USED:
            notes.append("no position system is marked as active: that with most positions is taken")
        elif others := sorted({f"{number}" for rank, kind, number in self.positions if rank and kind == best[1]}):
            used = " and ".join(f"{number:.0f}" for number in np.unique(rows[:, -1]))
            notes.append(f"positions are those of system {used}, which is active; not those of {' and '.join(others)}")
        rows = _steady(rows)
        if len(np.unique(rows[:, 0])) == 1:
            places, of_one = _reckoned(stamps, rows[0])
            notes += of_one
        else:
            places, known = between(stamps, rows[:, 0], rows[:, 1:3], _GAPS["position"], _BEYOND["position"])
            places[~known] = np.nan
        places[:, 1] = (places[:, 1] + 180) % 360 - 180
        return places, int(rows[-1, -1]) if len(rows) else 0, notes

    def attitudes(self, stamps: np.ndarray) -> tuple[np.ndarray, list[str]]:
        """(P, 2) rolls and pitches [deg], and notes: interpolated from the best sensor that has readings before and
        after a ping, else extrapolated, else 0."""
        turned, notes, sources = np.full((len(stamps), 2), np.nan), list[str](), self._ordered(self.motions)
        if sources and sources[0][0][0] == UNUSED:
            notes.append("no motion sensor is marked as active: that with most attitudes is taken")
        used = [rows for source, rows in sources if source[0] != UNUSED] or [rows for _, rows in sources[:1]]
        for rows, beyond in [(rows, beyond) for beyond in (0.0, _BEYOND["attitude"]) for rows in used]:
            values, known = between(stamps, rows[:, 0], rows[:, 1:3], _GAPS["attitude"], beyond)
            known &= np.isnan(turned[:, 0])
            turned[known] = values[known]
        without = np.isnan(turned[:, 0])
        if without.any():
            notes.append(f"{counted(int(without.sum()), 'ping')} without roll and pitch, taken as level")
        return np.nan_to_num(turned), notes

    @staticmethod
    def _ordered(sensors: dict[_Source, list[np.ndarray]]) -> list[tuple[_Source, np.ndarray]]:
        """Sources and their rows, the best first: by rank and type, then by most rows."""
        joined = {source: np.concatenate(rows) for source, rows in sensors.items()}
        return sorted(joined.items(), key=lambda item: (*item[0][:2], -len(item[1])))


def lever_of(values: Mapping[str, str], what: str = "") -> np.ndarray:
    """(3,) position [m], forward, port, up of the vessel's reference point, from {`what` and axis: number}; 0 if
    unknown."""
    try:
        place = np.array([float(values.get(f"{what}{axis}", "0")) for axis in "XYZ"])
    except ValueError:
        return np.zeros(3)
    return place * [1, -1, -1] if (np.abs(place) < 1000).all() else np.zeros(3)


def _steady(rows: np.ndarray) -> np.ndarray:
    """(n, 6) positions ordered by time, with unwrapped longitudes; outliers far from both neighbors are left out."""
    rows = rows[np.argsort(rows[:, 0], kind="stable")]
    rows[:, 2] = np.unwrap(rows[:, 2], period=360)
    if len(rows) < 3:
        return rows
    steps = np.diff(rows[:, :3], axis=0)
    steps[:, 2] *= np.cos(np.radians(rows[1:, 1]))
    far = _DEGREE * np.hypot(steps[:, 1], steps[:, 2]) > _LEAP + _FASTEST * steps[:, 0]
    return rows[~(np.concatenate([[True], far]) & np.concatenate([far, [True]]))]


def _reckoned(stamps: np.ndarray, row: np.ndarray) -> tuple[np.ndarray, list[str]]:
    """(P, 2) latitudes and longitudes [deg] from one position by its velocity, NaN too long before or after it; and a
    note if a ping has another time."""
    moves = np.isfinite(row[3:5]).all()
    after = stamps - row[0]
    shift = after[:, None] * np.nan_to_num(row[3:5]) / (_DEGREE * np.array([1.0, np.cos(np.radians(row[1]))]))
    places = row[1:3] + shift
    far = ~(np.abs(after) <= _BEYOND["position"])
    places[far] = np.nan
    how = "by its speed and course over ground" if moves else "there, as it has no speed"
    note = f"only one position: pings within {_BEYOND['position']:g} s of it are placed {how}"
    return places, [note] * bool(after.any())
