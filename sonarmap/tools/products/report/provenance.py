"""Provenance of a map: its title, its settings and its citation."""

import glob
import math
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path, PurePath
from typing import Any

import numpy as np

from sonarmap.kernels.counted import counted
from sonarmap.tools.files.time_scales import are_times, utc_text

_NAMED = 3  # largest number of inputs in a title
_DATE = len("2024-05-17")
# Units of settings by name; others are counts, shares and names.
UNITS = {
    "edge": "voxels",
    "voxel": "m",
    "map_voxel": "m",
    "cell_voxels": "voxels",
    "floor_voxels": "voxels",
    "floor_rotation": "rad",
    "max_tilt": "rad",
    "speed": "m/s",
    "turn_rate": "rad/s",
    "step": "m",
    "bound": "standard deviations",
    "min_seen": "scans",
    "sound_speed": "m/s",
    "nav_offset": "s",
    "magnetic_declination": "deg",
}
CITATION = (
    "Bülow, H., Birk, A.: Spectral registration of noisy sonar data for underwater 3D mapping. "
    "Autonomous Robots 30 (2011). doi:10.1007/s10514-011-9221-8"
)


def inputs_of(settings: Mapping[str, Any]) -> list[str]:
    """Input files, folders or patterns as the user gave them."""
    given = settings.get("inputs", [])
    return [str(path) for path in (given if isinstance(given, list) else [given])]


def survey_name(inputs: Sequence[str]) -> str:
    """Names of the first files or folders given; for a pattern, or for many files of one folder, the folder's name;
    empty without inputs."""
    folders = {Path(path).absolute().parent for path in inputs}
    if len(inputs) > _NAMED and len(folders) == 1:
        inputs = [str(*folders)]
    names = list(dict.fromkeys(_name(path) for path in inputs))
    return ", ".join(names[:_NAMED]) + (" and others" if len(names) > _NAMED else "")


def survey_date(stamps: np.ndarray) -> str:
    """Day of scans with these stamps (n,) [s], or the first and the last day; empty if the stamps are not times."""
    if not are_times(stamps):
        return ""
    first, last = (utc_text(float(stamp))[:_DATE] for stamp in (stamps.min(), stamps.max()))
    return first if first == last else f"{first} to {last}"


def plain_text(name: str, longest: int | None = None) -> str:
    """A name as one line of a figure's text: dollar signs, which begin formulas, are escaped, and long names shortened
    in the middle."""
    name = "".join(c if c.isprintable() else "?" for c in name)
    if longest is not None and len(name) > longest:
        name = f"{name[: longest // 2]}…{name[-((longest - 1) // 2) :]}"
    return name.replace("$", r"\$")


def _name(path: str) -> str:
    pure = PurePath(path)
    if glob.has_magic(pure.name) and pure.parent.name:
        return pure.parent.name
    return pure.name or Path(path).absolute().name or path


def title(inputs: Sequence[str], stamps: np.ndarray) -> str:
    """Title of a map: its inputs, number of scans and dates, from the stamps (N,) of the scans [s]."""
    what = f"Map of {survey_name(inputs)}, " if inputs else "Map of "
    return ", ".join(filter(None, [what + counted(len(stamps), "scan"), survey_date(stamps)]))


def setting_rows(settings: Mapping[str, Any]) -> list[tuple[str, str]]:
    """Full name of every setting, and its value in words."""
    return [(name, _worded(name.rpartition(".")[2], value)) for name, value in _flat(settings, "")]


def citation(versions: Mapping[str, Any]) -> str:
    """Citation of a map that these package versions made."""
    return f"Map made with sonarmap {versions.get('sonarmap') or ''}, by the method of {CITATION}".replace("  ", " ")


def _flat(value: Any, name: str) -> Iterator[tuple[str, Any]]:
    if isinstance(value, Mapping):
        for key, inner in value.items():
            yield from _flat(inner, f"{name}.{key}" if name else str(key))
    else:
        yield name, value


def _worded(name: str, value: Any) -> str:
    if value is None:
        return "not set"
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, list):
        return ", ".join(str(each) for each in value)
    if not isinstance(value, int | float) or name not in UNITS:
        return f"{value:.6g}" if isinstance(value, float) else str(value)
    unit = UNITS[name]
    in_degrees = f" ({math.degrees(value):.4g} deg{unit[3:]})" if unit.startswith("rad") else ""
    return f"{value:.6g} {unit}{in_degrees}"
