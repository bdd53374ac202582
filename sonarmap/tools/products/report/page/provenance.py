# pyright: strict
"""What a map was made with and from, as rows of text for the page."""

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from sonarmap.kernels.counted import counted
from sonarmap.tools.products.report.naming import survey_date, survey_name

# Of settings whose name does not say it; the others are counts, shares and names.
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


def title(inputs: Sequence[str], stamps: np.ndarray) -> str:
    """What was mapped, by the inputs as they were given, and when, by the stamps (N,) of the scans [s]."""
    what = f"Map of {survey_name(inputs)}, " if inputs else "Map of "
    return ", ".join(filter(None, [what + counted(len(stamps), "scan"), survey_date(stamps)]))


def setting_rows(settings: Mapping[str, Any]) -> list[tuple[str, str]]:
    """Every setting by its full name, and its value in words."""
    return [(name, _worded(name.rpartition(".")[2], value)) for name, value in _flat(settings, "")]


def citation(versions: Mapping[str, Any]) -> str:
    """How to cite a map that these versions made."""
    return f"Map made with sonarmap {versions.get('sonarmap') or ''}, by the method of {CITATION}".replace("  ", " ")


def _flat(value: Any, name: str) -> Iterator[tuple[str, Any]]:
    if isinstance(value, Mapping):
        for key, inner in value.items():  # pyright: ignore[reportUnknownVariableType]
            yield from _flat(inner, f"{name}.{key}" if name else str(key))  # pyright: ignore[reportUnknownArgumentType]
    else:
        yield name, value


def _worded(name: str, value: Any) -> str:
    if value is None:
        return "not set"
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, list):
        return ", ".join(str(each) for each in value)  # pyright: ignore[reportUnknownVariableType, reportUnknownArgumentType]
    if not isinstance(value, int | float) or name not in UNITS:
        return f"{value:.6g}" if isinstance(value, float) else str(value)
    unit = UNITS[name]
    in_degrees = f" ({math.degrees(value):.4g} deg{unit[3:]})" if unit.startswith("rad") else ""
    return f"{value:.6g} {unit}{in_degrees}"
