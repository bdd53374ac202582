"""Recognize the columns of a navigation file, and refuse ambiguous ones."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from difflib import get_close_matches

from sonarmap.kernels.errors import InputError
from sonarmap.tools.files.readers.instruments import COLUMNS, PRIOR_SIGMAS, SIGMA_COLUMNS
from sonarmap.tools.files.readers.navigation.headings import (
    KEYS,
    OWN,
    QUANTITIES,
    QUATERNION,
    SOURCES,
    Column,
    column_of,
)
from sonarmap.tools.files.readers.navigation.settings import NavigationSettings

PAIRS = (("roll_deg", "pitch_deg"), ("x_m", "y_m"))
PLACES = (("lat_deg", "lon_deg"), ("easting_m", "northing_m"), ("x_m", "y_m"))
MEASURED = tuple(name for name in QUANTITIES if name not in ("name", "stamp", "date", "gps_week", *SIGMA_COLUMNS))
_LISTED = 12  # columns that a note names
_MISSPELLED = 0.85  # similarity of rol_deg and roll_deg


@dataclass(frozen=True, slots=True)
class Columns:
    of: Mapping[str, Column]  # {quantity: its column}
    is_own: bool  # whether the file uses this program's own names, so that an unknown column is refused
    notes: tuple[str, ...]  # for the user: unused columns, assumptions

    @property
    def key(self) -> str:
        """The quantity that tells which scan a row is for: "name" or "stamp"."""
        return "name" if "name" in self.of else "stamp"

    def heading(self, quantity: str) -> str:
        return self.of[quantity].heading


def columns_of(header: Sequence[str], settings: NavigationSettings, sigmas: Mapping[str, float] | None) -> Columns:
    """The columns of a file, from its headings. A file is an own one if all recognized columns have exactly this
    program's names (`stamp`, `depth_m`, ...) and the user maps none: then any other column is refused as misspelled.
    In a log, unknown columns are left out, unless their heading is nearly one of the own names.
    `sigmas`: {column of COLUMNS: standard deviation} for columns without one in the file; None if none is needed."""
    notes: list[str] = []
    mapped = _mapped(header, settings, notes)
    taken = {column.index for column in mapped.values()}
    read = (column_of(k, heading) for k, heading in enumerate(header) if k not in taken and heading)
    known = [column for column in read if column is not None and column.quantity not in mapped]
    if any(column.heading.endswith("header.stamp") for column in known):
        known = [column for column in known if column.heading != "%time"]  # when rosbag recorded the message
    is_own = not mapped and all(column.is_own for column in known)
    _refuse_misspelled(header, known, mapped, is_own)
    of = {**_each_once(known, is_own), **mapped}
    _choose_heading(of, settings, notes)
    _choose_depth(of, settings)
    _choose_place(of, settings, mapped, notes)
    if not set(QUATERNION) <= of.keys() or {"roll_deg", "heading_deg", "yaw_deg"} & of.keys():
        for name in QUATERNION:
            of.pop(name, None)
    _check_keys(of, is_own, header)
    for lone, other in () if is_own else (PAIRS[0], PAIRS[0][::-1]):  # in a log roll without pitch is left out
        if lone in of and other not in of:
            notes.append(f"{of.pop(lone).heading!r} is not used without a column of {other}")
    _check_measured(of, None if sigmas is None else set(sigmas), is_own)
    used = {column.index for column in of.values()}
    left = [heading for k, heading in enumerate(header) if heading and k not in used]
    if left and not (is_own and left == ["stamp"]):  # `inspect --template` writes it beside the name, which counts
        more = f" and {len(left) - _LISTED} more" if len(left) > _LISTED else ""
        notes.append(f"not used: the columns {', '.join(map(repr, left[:_LISTED]))}{more}")
    return Columns(of, is_own, tuple(notes))


def _mapped(header: Sequence[str], settings: NavigationSettings, notes: list[str]) -> dict[str, Column]:
    """The columns that --nav-columns maps."""
    of: dict[str, Column] = {}
    for quantity, heading in settings.columns.items():
        exact = [k for k, each in enumerate(header) if each == heading]
        places = exact or [k for k, each in enumerate(header) if each.casefold() == heading.casefold()]
        if not places and settings.are_shared:
            notes.append(f"it has no column {heading!r}, which --nav-columns maps to {quantity}")
            continue
        if len(places) != 1:
            raise InputError(
                f"--nav-columns: {len(places)} columns are {heading!r}; wanted one of {', '.join(map(repr, header))}"
            )
        stated = column_of(places[0], header[places[0]])
        if stated and quantity.endswith("_m") and stated.quantity in ("lat_deg", "lon_deg"):
            raise InputError(f"--nav-columns: {heading!r} holds degrees, not meters; give {stated.quantity}={heading}")
        of[quantity] = column_of(places[0], header[places[0]], quantity) or Column(places[0], heading, quantity)
    return of


def _refuse_misspelled(header: Sequence[str], known: list[Column], mapped: Mapping[str, Column], is_own: bool) -> None:
    taken = {column.index for column in (*known, *mapped.values())}
    unknown = [heading for k, heading in enumerate(header) if k not in taken and (heading or is_own)]
    if is_own and unknown:
        raise InputError(f"unknown column {some(unknown)}; known are {', '.join(OWN)}; for others see --nav-columns")
    there = {column.heading for column in known}
    for heading in dict.fromkeys(unknown):
        if not heading.endswith(("_deg", "_m")) or column_of(0, heading):
            continue
        nearest = get_close_matches(heading, OWN, 1, _MISSPELLED)
        if nearest and nearest[0] not in there:
            raise InputError(f"the column {heading!r} looks like a misspelled {nearest[0]}; rename it")


def _each_once(known: list[Column], is_own: bool) -> dict[str, Column]:
    of: dict[str, Column] = {}
    for column in known:
        if (first := of.get(column.quantity)) is None:
            of[column.quantity] = column
        elif first.heading == column.heading:
            count = sum(each.heading == column.heading for each in known)
            raise InputError(f"the column {column.heading} is there {count} times; delete all but one")
        else:
            raise InputError(
                f"both {first.heading!r} and {column.heading!r} may be {column.quantity}; say which, as in "
                f"--nav-columns {column.quantity}={column.heading}"
            )
    return of


def _choose_heading(of: dict[str, Column], settings: NavigationSettings, notes: list[str]) -> None:
    if "magnetic_deg" in of and "heading_deg" not in of:
        if settings.declination is None:
            raise InputError(
                f"the column {of['magnetic_deg'].heading!r} holds magnetic headings; give the declination of the "
                "place and date, --magnetic-declination DEG (East positive)"
            )
        of["heading_deg"] = of["magnetic_deg"]
    elif "yaw_deg" in of and "heading_deg" not in of:
        if settings.frame is None:
            raise InputError(
                f"the column {of['yaw_deg'].heading!r} may be clockwise from North (--nav-frame ned) or "
                "counterclockwise from East (--nav-frame enu); say which, or --nav-columns "
                f"heading_deg={of['yaw_deg'].heading} if it is a compass heading"
            )
        return
    if settings.declination is not None and "heading_deg" in of:
        notes.append(f"{settings.declination:g} degrees are added to the magnetic headings")
    of.pop("magnetic_deg", None)
    of.pop("yaw_deg", None)


def _choose_depth(of: dict[str, Column], settings: NavigationSettings) -> None:
    if "z_m" in of and settings.frame is None and not ("depth_m" in of or "height_m" in of):
        raise InputError(
            f"the column {of['z_m'].heading!r} may count downward (--nav-frame ned) or upward (--nav-frame enu); say "
            f"which, or --nav-columns depth_m={of['z_m'].heading} or height_m={of['z_m'].heading}"
        )
    there = [name for name in ("depth_m", "height_m", "z_m") if name in of]
    for name in there[1:]:
        of.pop(name)


def _choose_place(
    of: dict[str, Column], settings: NavigationSettings, mapped: Mapping[str, Column], notes: list[str]
) -> None:
    """Keep one pair of latitude and longitude, easting and northing, or x and y."""
    for first, second in PLACES[:2]:
        if (first in of) != (second in of):
            there, missing = (first, second) if first in of else (second, first)
            raise InputError(f"{there} ({of[there].heading!r}) needs {missing}; give both, or use --nav-columns")
    there = [pair for pair in PLACES if pair[0] in of or pair[1] in of]
    wanted = [pair for pair in there if pair[0] in mapped]
    if settings.crs is not None:
        if PLACES[1] in there:
            wanted = [PLACES[1]]
        elif not settings.are_shared:
            raise InputError("--nav-crs has no effect without columns of easting and northing; leave it out")
    if len(there) > 1 and not wanted and any(of[name].is_own for name in PLACES[2] if name in of):
        raise InputError(
            f"there are x_m and y_m beside places; say --nav-columns {there[0][0]}={of[there[0][0]].heading}"
        )
    if not there:
        return
    kept = (wanted or there)[0]
    for pair in there:
        if pair != kept:
            notes.append(f"places are taken from {' and '.join(of[name].heading for name in kept)}")
            for name in pair:
                of.pop(name, None)
    if settings.frame is None and kept == PLACES[2] and not all(of[name].is_own for name in kept if name in of):
        notes.append("x is taken as East and y as North; if x is North, give --nav-frame ned")


def _check_keys(of: dict[str, Column], is_own: bool, header: Sequence[str]) -> None:
    if "name" in of and "stamp" in of and (of["name"].heading == "name" or is_own):
        of.pop("stamp")  # as in a template
        of.pop("date", None)
    if "stamp" not in of and "date" in of and "name" not in of:
        of["stamp"] = of.pop("date")
    if sum(key in of for key in KEYS) != 1:
        both = f" ({of['name'].heading!r} and {of['stamp'].heading!r} may both be it)" if "name" in of else ""
        raise InputError(
            f"wanted either a column name or a column stamp, which tells the scan of a row{both}; there "
            f"are {', '.join(map(repr, header))}; known are Scan, Time, Zeit, Heure and others, or map it, as "
            "in --nav-columns stamp=T"
        )


def _check_measured(of: Mapping[str, Column], known: Collection[str] | None, is_own: bool) -> None:
    """Refuse missing measurements and sigmas; those of COLUMNS in `known` need no sigma; with None, none does."""
    if not any(name in of for name in MEASURED):
        raise InputError(f"there is no column of measurements; wanted some of {', '.join(COLUMNS)}, or lat and lon")
    for first, second in PAIRS:
        if (first in of) != (second in of):
            raise InputError(f"{first} and {second} can only be used together; give both or neither")
    if known is None:
        return
    for column, sigma, names in zip(COLUMNS, SIGMA_COLUMNS, SOURCES, strict=True):
        measured = [of[name].heading for name in names if name in of]
        if sigma in of and not measured and is_own:
            raise InputError(f"there is a column {sigma} but no {column}; delete it, or add {column}")
        if measured and sigma not in of and column not in known:
            which = column if measured[0] == column else f"{column} ({measured[0]!r})"
            raise InputError(f"{which} has no standard deviation; add a column {sigma}, or give {PRIOR_SIGMAS}")


def some(names: Sequence[str]) -> str:
    return ", ".join(repr(name) for name in names[:3]) + (", ..." if len(names) > 3 else "")
