# pyright: strict
"""How a dive goes, in one sentence."""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Standing:
    """What there is to say."""

    scans: int = 0
    placed: int = 0
    loops: int = 0
    parts: int = 0  # that are not joined
    alone: bool = False  # whether the vehicle is in another part than most of the map
    behind: int = 0  # scans that wait
    late: float = 0.0  # how long ago the last placed scan was taken, as far as later ones have come [s]
    missing: int = 0  # shots that did not come
    silent: float = 0.0  # how long nothing has come [s]
    lost_for: float | None = None  # [s]
    sigma: float | None = None  # of the vehicle's place [m]


_SILENT, _LATE = 3.0, 1.0  # [s] that are worth a word


def sentence(status: str, standing: Standing) -> str:
    """The status as of `tools.products.live.messages.State`, and what is known."""
    first = {
        "waiting": "Waiting for scans",
        "placed": "Placed" if not standing.sigma else f"Placed to within {_length(standing.sigma)}",
        "uncertain": f"Placed, but only to within {_length(standing.sigma or 0.0)}",
        "lost": _lost(standing),
        "ended": "The dive has ended",
    }[status]
    rest = [f"{standing.placed:,} of {standing.scans:,} scans placed", _counted(standing.loops, "loop")]
    if standing.parts > 1:
        rest.append(f"{standing.parts} parts that nothing joins yet")
    if standing.missing:
        rest.append(f"{_counted(standing.missing, 'shot')} missing")
    if standing.late > _LATE:
        behind = "256 or more scans" if standing.behind >= 256 else _counted(standing.behind, "scan")
        rest.append(f"{behind}, {standing.late:.0f} s, behind")
    if standing.silent > _SILENT and status != "ended":
        rest.append(f"nothing has come for {standing.silent:.0f} s")
    return f"{first}; {', '.join(rest)}." if standing.scans or standing.silent > _SILENT else f"{first}."


def _lost(standing: Standing) -> str:
    since = f" for {standing.lost_for:.0f} s" if standing.lost_for is not None else ""
    if standing.alone:
        return f"Lost{since}: what is seen now is a map of its own until a known place is seen again"
    return f"Lost{since}: nothing that is seen fits the map; go back to the last sure place"


def _length(meters: float) -> str:
    return f"{100 * meters:.0f} cm" if meters < 1 else f"{meters:.1f} m"


def _counted(number: int, noun: str) -> str:
    return f"{number:,} {noun}{'' if number == 1 else 's'}"
