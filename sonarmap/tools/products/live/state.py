# pyright: strict
"""How a dive goes: as one sentence, and as a message for the page."""

import json
from dataclasses import asdict, dataclass
from typing import Literal

from sonarmap.kernels.counted import counted

Status = Literal["waiting", "recording", "placed", "uncertain", "lost", "ended"]
_SILENT, _LATE = 3.0, 1.0  # [s] that are worth a word
_MANY = 256  # scans that wait in memory at most


@dataclass(frozen=True, slots=True)
class State:
    """What there is to say; poses and places are in the frame of a part of the map."""

    status: Status = "waiting"
    scans: int = 0
    placed: int = 0
    keys: int = 0
    loops: int = 0
    parts: int = 0  # that are not joined
    alone: bool = False  # whether the vehicle is in another part than most of the map
    behind: int = 0  # scans that wait
    late: float = 0.0  # how long ago the last placed scan was taken, as far as later ones have come [s]
    missing: int = 0  # shots that did not come
    silent: float = 0.0  # how long nothing has come [s]
    lost_for: float | None = None  # [s]
    sigma: float = 0.0  # of the vehicle's place [m]; 0 where it is not known
    part: int = 0  # in which the vehicle is
    own: int = 0  # the number of the dive's first key scan: those before are of a finished map
    stamp: float | None = None  # of the last placed scan [s]
    pose: list[float] | None = None  # of the vehicle then: x, y, z [m] and the quaternion x, y, z, w
    half_axes: list[list[float]] | None = None  # three, of the ellipsoid of a standard deviation about it [m]
    sure: tuple[int, list[float]] | None = None  # the part and the place where it was last sure [m]
    depth: float | None = None  # below the start [m]
    speed: float | None = None  # [m/s]
    turn_rate: float | None = None  # positive to the left [deg/s]
    alerts: tuple[str, ...] = ()

    @property
    def sentence(self) -> str:
        """The status, and what is known."""
        first = {
            "waiting": "Waiting for scans",
            "recording": "The recording goes on, and the mapping begins again",
            "placed": f"Placed to within {_length(self.sigma)}" if self.sigma else "Placed",
            "uncertain": f"Placed, but only to within {_length(self.sigma)}",
            "lost": f"Lost{'' if self.lost_for is None else f' for {self.lost_for:.0f} s'}: {self._where_to_go()}",
            "ended": "The dive has ended",
        }[self.status]
        rest = [f"{self.placed:,} of {self.scans:,} scans placed", counted(self.loops, "loop")]
        if self.parts > 1:
            rest.append(f"{self.parts} parts that nothing joins yet")
        if self.missing:
            rest.append(f"{counted(self.missing, 'shot')} missing")
        if self.late > _LATE:
            behind = f"{_MANY} or more scans" if self.behind >= _MANY else counted(self.behind, "scan")
            rest.append(f"{behind} ({self.late:.0f} s) behind")
        if self.silent > _SILENT and self.status != "ended":
            rest.append(f"nothing has come for {self.silent:.0f} s")
        return f"{first}; {', '.join(rest)}." if self.scans or self.silent > _SILENT else f"{first}."

    @property
    def message(self) -> str:
        """As JSON."""
        return json.dumps({"kind": "state", "sentence": self.sentence, **asdict(self)}, allow_nan=False)

    def _where_to_go(self) -> str:
        if self.alone:
            return "mapping a separate part until a known place is seen again"
        return "no scan matches the map; return to the last confirmed position"


def _length(meters: float) -> str:
    return f"{100 * meters:.0f} cm" if meters < 1 else f"{meters:.1f} m"
