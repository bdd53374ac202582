"""How much instruments usually err, by what a log calls them: where neither it nor a user gives standard deviations.

From data sheets of usual ones, rather too large: that errors are larger than stated is measured while a map is made,
that they are smaller is not.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

from sonarmap.tools.files.readers.instruments import COLUMNS


@dataclass(frozen=True, slots=True)
class Instrument:
    """One kind of instrument."""

    name: str
    words: frozenset[str]  # any of which in a heading names it
    sigmas: Mapping[str, float]  # of COLUMNS [deg, m], of what it can measure


def _attitude(degrees: float) -> dict[str, float]:
    return {"roll_deg": degrees, "pitch_deg": degrees}


def _place(meters: float) -> dict[str, float]:
    return {"x_m": meters, "y_m": meters}


# The first that a heading names counts.
INSTRUMENTS = (
    Instrument("RTK", frozenset(("rtk", "ppk")), _place(0.05)),
    Instrument("floating RTK", frozenset(("rtkfloat",)), _place(0.5)),
    Instrument("DGNSS", frozenset(("dgps", "dgnss", "sbas", "egnos", "waas")), _place(1.5)),
    Instrument("GNSS", frozenset(("gnss", "gps")), _place(3.0)),
    Instrument("USBL", frozenset(("usbl", "ssbl", "hipap")), _place(3.0)),
    Instrument("LBL", frozenset(("lbl",)), _place(0.5)),
    Instrument("gyrocompass", frozenset(("gyro", "gyrocompass", "fog", "hdt")), {"heading_deg": 1.0}),
    Instrument("compass", frozenset(("compass", "magnetic", "mag", "hdm", "fluxgate")), {"heading_deg": 5.0}),
    Instrument("motion sensor", frozenset(("mru", "vru", "ahrs", "imu")), {**_attitude(0.5), "heading_deg": 2.0}),
    Instrument("pressure", frozenset(("pressure", "ctd", "digiquartz", "paros")), {"depth_m": 0.1}),
)
WORDS = frozenset(word for each in INSTRUMENTS for word in each.words)


def usual_of(column: str, words: Iterable[str]) -> tuple[Instrument, float] | None:
    """The instrument that a heading names by its words in small letters, and what it errs by in one of COLUMNS; None
    where it names none that measures this."""
    named = set(words)
    return next(
        ((each, each.sigmas[column]) for each in INSTRUMENTS if each.words & named and column in each.sigmas), None
    )


def usual_note(named: Mapping[str, tuple[Instrument, float]]) -> str:
    """What is taken for the columns of COLUMNS, in words."""
    said = [
        f"{column.rsplit('_', 1)[0]} {sigma:g} {'degrees' if column.endswith('deg') else 'm'} ({each.name})"
        for column, (each, sigma) in named.items()
        if column in COLUMNS
    ]
    return f"standard deviations are taken to be {', '.join(said)}; --prior-sigmas gives others"
