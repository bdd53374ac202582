# pyright: strict, reportMissingTypeStubs=false, reportUnknownMemberType=false
# pyright: reportUnknownVariableType=false, reportUnknownArgumentType=false
"""E57 by pye57: a scan of the file for each scan, or one for all of the map.

pye57 stores coordinates in four bytes. They count from the sensor's place, or the middle of the map, which is the
scan's pose in the file, in eight bytes: readers add it.
"""

from collections.abc import Generator, Mapping
from contextlib import contextmanager
from hashlib import sha256
from itertools import count
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from uuid import NAMESPACE_OID, uuid5

import numpy as np

from sonarmap.tools.files.time_scales import gps_of_utc
from sonarmap.tools.files.writers.atomic import atomic_path
from sonarmap.tools.products.export.clouds.cloud import Cloud, Portion

_UPRIGHT = np.array([1.0, 0.0, 0.0, 0.0])  # quaternion w, x, y, z


def write_e57(path: Path, cloud: Cloud) -> Mapping[str, Any]:
    """Write places, and echo strengths where there are any, portion by portion; the time of a scan is that of its
    beginning, as GPS time. Returns what counts from what."""
    from pye57 import E57  # pyright: ignore[reportMissingTypeStubs]
    from pye57 import e57 as library  # pyright: ignore[reportMissingTypeStubs]

    total = 0
    seed = sha256(cloud.part.points.tobytes() + repr(cloud.chosen).encode()).hexdigest()
    with atomic_path(path) as temporary, _guids_from(library, seed):
        temporary.unlink()
        with E57(str(temporary), mode="w") as file:
            for portion in cloud.portions():
                _write(file, portion, cloud.timed and cloud.scans is not None)
                total += len(portion.points)
    return {
        "points": total,
        "scans": "one per scan of the sonar, by its name" if cloud.scans is not None else "one, the map",
        "coordinates": "float32 from the pose's translation, which is float64: the sensor's place, or the map's middle",
        "intensity": "linear echo strength; 0 where there is none",
    }


@contextmanager
def _guids_from(module: Any, seed: str) -> Generator[None]:
    """GUIDs that follow from what is written, where pye57 draws them: the same map gives the same bytes."""
    drawn, number = module.uuid, count()
    module.uuid = SimpleNamespace(uuid4=lambda: uuid5(NAMESPACE_OID, f"{seed} {next(number)}"))
    try:
        yield
    finally:
        module.uuid = drawn


def _write(file: Any, portion: Portion, timed: bool) -> None:
    places = portion.points - portion.place
    columns: dict[str, np.ndarray] = {f"cartesian{axis}": column for axis, column in zip("XYZ", places.T, strict=True)}
    if "intensity" in portion.columns:
        columns["intensity"] = np.nan_to_num(portion.columns["intensity"])
    bounds = {f"{axis}Minimum": least for axis, least in zip("xyz", portion.points.min(axis=0).tolist(), strict=True)}
    bounds |= {f"{axis}Maximum": most for axis, most in zip("xyz", portion.points.max(axis=0).tolist(), strict=True)}
    if timed:
        bounds["acquisitionStart_dateTimeValue"] = float(gps_of_utc(portion.stamps[:1])[0])
    header = SimpleNamespace(**bounds)
    file.write_scan_raw(columns, name=portion.name, rotation=_UPRIGHT, translation=portion.place, scan_header=header)
