"""The quantity and the unit that the heading of a log's column names."""

import re
import unicodedata
from dataclasses import dataclass

import numpy as np

from sonarmap.kernels.errors import InputError
from sonarmap.tools.files.readers.instruments import COLUMNS, SIGMA_COLUMNS

KEYS = ("name", "stamp")
OWN = (*KEYS, *COLUMNS, *SIGMA_COLUMNS)  # the headings of this program's own files
FOOT = 0.3048  # the international foot [m]
# Names of the quantities in English, German and French logs, in small letters and digits, without accents
SYNONYMS = {
    "name": "name scan scanname file filename",
    "stamp": "stamp time timestamp utc utctime timeutc datetime datetimeutc timeofday unixtime unix epoch epochtime "
    "posixtime gpstime gpsseconds gpstow tow timeofweek secondsofweek sow "
    "zeit uhrzeit zeitstempel heure temps horodatage",
    "date": "date utcdate dateutc datum",
    "gps_week": "week gpsweek weeknumber",
    "roll_deg": "roll rollangle rollen rollwinkel roulis",
    "pitch_deg": "pitch pitchangle stampfen stampfwinkel nicken nickwinkel tangage",
    "heading_deg": "heading hdg hdt trueheading headingtrue gyro gyroheading kurs steuerkurs cap",
    "magnetic_deg": "magneticheading headingmagnetic magheading headingmag hdm hdgmag compassheading",
    "yaw_deg": "yaw yawangle gieren gierwinkel lacet",
    "x_m": "x posx xpos positionx xposition tx px prsrx",
    "y_m": "y posy ypos positiony yposition ty py prsry",
    "z_m": "z posz zpos positionz zposition tz pz prsrz",
    "qw": "qw orientationw rotationw quaternionw quatw qrsw",
    "qx": "qx orientationx rotationx quaternionx quatx qrsx",
    "qy": "qy orientationy rotationy quaterniony quaty qrsy",
    "qz": "qz orientationz rotationz quaternionz quatz qrsz",
    "depth_m": "depth dpt vehicledepth rovdepth auvdepth sensordepth sonardepth tiefe profondeur immersion",
    "height_m": "",
    "lat_deg": "lat latitude gpslat gpslatitude breite breitengrad",
    "lon_deg": "lon long lng longitude gpslon gpslong gpslongitude lange laenge langengrad laengengrad",
    "easting_m": "easting eastings east utme utmeasting rechtswert ostwert",
    "northing_m": "northing northings north utmn utmnorthing hochwert nordwert",
}
QUANTITIES = (*SYNONYMS, *SIGMA_COLUMNS)
GPS_NAMES = frozenset(["gpstime", "gpsseconds", "gpstow", "tow", "timeofweek", "secondsofweek", "sow"])
# Quantities from which each of COLUMNS may be computed
SOURCES = (
    ("roll_deg", "qw"),
    ("pitch_deg", "qw"),
    ("heading_deg", "yaw_deg", "qw"),
    ("x_m", "lon_deg", "easting_m"),
    ("y_m", "lat_deg", "northing_m"),
    ("depth_m", "z_m", "height_m"),
)
QUATERNION = ("qx", "qy", "qz", "qw")
_SIGMA_OF = {name: sigma for names, sigma in zip(SOURCES, SIGMA_COLUMNS, strict=True) for name in names}
_SIGMA_OF["magnetic_deg"] = _SIGMA_OF["heading_deg"]
_QUANTITY_OF = {synonym: quantity for quantity, synonyms in SYNONYMS.items() for synonym in synonyms.split()}
# Words of instruments and ROS messages, which a heading may have beside the quantity, as in USBL Easting
_INSTRUMENT_WORDS = (
    "rtk ppk rtkfloat dgps dgnss sbas egnos waas gnss gps usbl ssbl hipap lbl gyro gyrocompass fog hdt compass "
    "magnetic mag hdm fluxgate mru vru ahrs imu pressure ctd digiquartz paros "
    "field header pose point transform translation"
)
_SIGMA_WORDS = frozenset(("sigma", "std", "stddev", "stdev", "sd"))
_ANGLES = dict.fromkeys(("deg", "degree", "degrees", "°", "grad", "degre", "degres"), 1.0)
_ANGLES |= dict.fromkeys(("rad", "radian", "radians"), 180 / np.pi)
_LENGTHS = dict.fromkeys(("m", "meter", "meters", "metre", "metres"), 1.0) | {"cm": 0.01, "mm": 0.001, "km": 1000.0}
_LENGTHS |= dict.fromkeys(("ft", "feet", "foot"), FOOT)
_TIMES = {"s": 1.0, "sec": 1.0, "seconds": 1.0, "ms": 1e-3, "us": 1e-6, "µs": 1e-6, "ns": 1e-9}
_UNITS = {"deg": _ANGLES, "m": _LENGTHS, "s": _TIMES}
_REFERENCES = ("true", "t")  # of a heading, where its unit would stand
_MAGNETIC = ("magnetic", "mag")
# Each of these takes linear time for any heading
_BRACKETS = re.compile(r"(.*)[\(\[]([^()\[\]]*)[\)\]]")
_BETWEEN_WORDS = re.compile(r"[\s_.]+")
_ZONE = re.compile(r"(?:utc|gmt|z)?\s*(?:([+-])(\d{1,2})(?::?(\d\d))?)?", re.IGNORECASE)
_WORDS = re.compile(r"[a-z]+|[0-9]+")


@dataclass(frozen=True, slots=True)
class Column:
    """A recognized column of a log."""

    index: int  # in the rows
    heading: str  # as written
    quantity: str  # of QUANTITIES
    factor: float = 1.0  # from its unit to that of the quantity's name (degrees, meters, seconds)
    word: str = ""  # the heading without unit and sigma, only small letters and digits
    unit: str = ""  # as written, in small letters; "" if there is none

    @property
    def is_own(self) -> bool:
        return self.heading in OWN


def column_of(index: int, heading: str, quantity: str | None = None) -> Column | None:
    """The column with a heading; None if it is not recognized. `quantity`: given by the user, so that only the unit is
    read from the heading."""
    if heading in OWN:
        return Column(index, heading, quantity or heading, word=heading)
    stem, unit = _split(_plain(heading))
    words = _WORDS.findall(stem.lower())
    word = "".join(each for each in words if each not in _SIGMA_WORDS)
    bare = "".join(each for each in words if each not in _SIGMA_WORDS and each not in _INSTRUMENT_WORDS.split())
    names = (each for name in (word, bare) for each in (name, re.sub("(deg|degrees|(?<!g)rad|radians)$", "", name)))
    known = quantity or next((_QUANTITY_OF[name] for name in names if name in _QUANTITY_OF), None)
    if known is None:
        return None
    if known == "heading_deg" and quantity is None and unit in _MAGNETIC:
        return Column(index, heading, "magnetic_deg", 1.0, word, unit)
    if not unit and (ending := re.search("(deg|degrees|(?<!g)rad|radians)$", word)):
        unit = ending[0]
    if quantity is None and len(words) > 1 and _SIGMA_WORDS.intersection(words):
        if known not in _SIGMA_OF:
            return None
        known = _SIGMA_OF[known]
    return Column(index, heading, known, _factor(heading, known, unit), word, unit)


def is_unit(text: str) -> bool:
    return any(text.strip("()[] ").lower() in units for units in _UNITS.values())


def _plain(heading: str) -> str:
    return "".join(each for each in unicodedata.normalize("NFD", heading) if not unicodedata.combining(each))


def zone_of(unit: str) -> float | None:
    """Offset of a zone like "UTC+2" or "+02:00" from UTC [s], positive ahead; None if it is not a zone."""
    zone = _ZONE.fullmatch(unit)
    if not unit or not zone:
        return None
    seconds = 3600 * int(zone[2] or 0) + 60 * int(zone[3] or 0)
    return float(-seconds if zone[1] == "-" else seconds)


def _split(heading: str) -> tuple[str, str]:
    """The heading without its unit, and the unit in small letters."""
    heading = heading.strip()
    bracketed = _BRACKETS.fullmatch(heading)
    if bracketed:
        return bracketed[1], bracketed[2].strip().lower()
    *before, last = _BETWEEN_WORDS.split(heading)
    if before and any(last.lower() in units for units in _UNITS.values()):
        return heading.removesuffix(last), last.lower()
    return heading, ""


def _factor(heading: str, quantity: str, unit: str) -> float:
    kind = quantity.rsplit("_", 1)[-1] if quantity != "stamp" else "s"
    units = _UNITS.get(kind)
    if not unit or units is None or (kind == "s" and unit not in units):
        return 1.0  # the unit of a time may also be a zone, which `times_of` reads
    unit = unit if unit in units else unit.split()[0]  # as in "m below surface"
    if kind == "deg" and (unit in _REFERENCES or (quantity in ("lat_deg", "lon_deg") and unit not in _LENGTHS)):
        return units.get(unit, 1.0)
    if unit not in units:
        raise InputError(f"the column {heading!r} has the unit {unit!r}; wanted {', '.join(units)} for {quantity}")
    if units[unit] == FOOT and quantity in ("easting_m", "northing_m"):
        raise InputError(f"the column {heading!r} is in feet, international or US survey ones; give it in meters")
    return units[unit]
