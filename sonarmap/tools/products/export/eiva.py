"""Positions and attitudes as EIVA NaviEdit merges them: its formats "NavLab" for position and for attitude.

Layout: EIVA's support page "Merge format" (https://eiva.freshdesk.com/support/solutions/articles/43000529417). A line
is Unix seconds, latitude and longitude [rad] and depth [m]; or Unix seconds, roll, pitch and heading [rad]. There is no
line of names.
"""
# pyright: strict, reportMissingTypeStubs=false, reportUnknownMemberType=false

from pathlib import Path

import numpy as np

from sonarmap.tools.files.writers.atomic import atomic_path
from sonarmap.tools.products.export.georeferenced import Georeferenced


def write_eiva_position(path: Path, earth: Georeferenced) -> None:
    """Write Unix time [s], latitude, longitude [rad], WGS84, and depth [m], positive down, ascending in time."""
    places = np.column_stack([np.radians(earth.poses[:, :2]), -earth.poses[:, 2]])
    _write(path, earth, places, ("z.14f", "z.14f", "z.5f"))


def write_eiva_attitude(path: Path, earth: Georeferenced) -> None:
    """Write Unix time [s], roll (starboard down), pitch (nose up) and true heading [rad], ascending in time."""
    _write(path, earth, np.radians(earth.attitudes), ("z.10f", "z.10f", "z.10f"))


def _write(path: Path, earth: Georeferenced, rows: np.ndarray, formats: tuple[str, ...]) -> None:
    lines: list[str] = []
    for k in earth.in_time:
        numbers = (format(x, spec) for x, spec in zip(rows[k].tolist(), formats, strict=True))
        lines.append(f"{float(earth.stamps[k]):.6f} {' '.join(numbers)}\n")
    with atomic_path(path) as temporary:
        temporary.write_text("".join(lines))
