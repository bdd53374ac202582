"""A file of navigation of any kind: CSV, TUM or NMEA 0183."""

import codecs
import warnings
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from sonarmap.kernels.errors import InputError
from sonarmap.tools.files.readers.instruments import COLUMNS, PRIOR_SIGMAS, values_of
from sonarmap.tools.files.readers.navigation.log import NavigationLog
from sonarmap.tools.files.readers.navigation.nmea import SENTENCE, read_nmea
from sonarmap.tools.files.readers.navigation.settings import OF_NMEA, OF_TABLES, UP_FRAMES, NavigationSettings
from sonarmap.tools.files.readers.navigation.table import read_table
from sonarmap.tools.files.readers.poses.trajectory import read_tum
from sonarmap.tools.files.user_file import reading, require_file

_LOOKED_AT = 20_000  # bytes of a file's beginning that tell its kind
_TUM_NUMBERS = 8


def read_navigation(
    path: Path, settings: NavigationSettings, sigmas: Mapping[str, float] | None, scans: np.ndarray, notes: list[str]
) -> NavigationLog:
    """The rows of a file, which is told by its content. `sigmas`: {column of COLUMNS: standard deviation} where the
    file has none; None where none is needed."""
    beginning = beginning_of(path)
    if SENTENCE.search(beginning):
        return read_nmea(path, settings, scans, notes)
    if path.suffix.lower() != ".tum" and not _is_tum(beginning):
        settings.refuse_unused(path, "holds no NMEA sentences", OF_NMEA)
        return read_table(path, settings, sigmas, scans, notes)
    if sigmas is not None and not set(COLUMNS).issubset(sigmas):
        raise InputError(f"{path} has no standard deviations; give {PRIOR_SIGMAS}")
    return _of_tum(path, settings)


def beginning_of(path: Path) -> str:
    """The first characters of a file, which tell its kind. Raises InputError: it cannot be read."""
    require_file(path)
    with reading(path), path.open("rb") as file:
        content = file.read(_LOOKED_AT)
    wide = content.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE))
    return content.decode("utf-16" if wide else "utf-8", errors="replace")


def _is_tum(beginning: str) -> bool:
    """Whether the first line that is no comment is eight numbers between blanks."""
    lines = (line.strip() for line in beginning.splitlines())
    first = next((line for line in lines if line and not line.startswith("#")), "")
    try:
        return len([float(word) for word in first.split()]) == _TUM_NUMBERS
    except ValueError:
        return False


def _of_tum(path: Path, settings: NavigationSettings) -> NavigationLog:
    """A trajectory: T_world_vehicle, East-North-Up, x forward, y left, z up."""
    settings.refuse_unused(path, "is a TUM file", OF_TABLES + OF_NMEA, UP_FRAMES)
    trajectory = read_tum(path)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of scipy: looking straight up or down a rotation has many headings and rolls
        values = values_of(trajectory.T_world_sensor)
    keys = tuple(f"{stamp:.3f}" for stamp in trajectory.stamps.tolist())
    lines = np.arange(1, len(trajectory.stamps) + 1)
    return NavigationLog("stamp", lines, keys, trajectory.stamps, values, np.full_like(values, np.nan), None)
