"""The scans that a finished map was made of, read again: its folder holds none of their points."""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from scipy.spatial.transform import RigidTransform

from sonarmap.kernels.errors import InputError
from sonarmap.slam.graph.trajectory import Trajectory
from sonarmap.slam.motion.straighten import straightened
from sonarmap.slam.pings.biases import Biases
from sonarmap.spectral.scan import Scan
from sonarmap.tools.files.inputs import input_rows
from sonarmap.tools.files.map_folder.folder import Map
from sonarmap.tools.files.map_folder.names import SUMMARY, as_written
from sonarmap.tools.files.readers.corrections import Corrections, PointFrame
from sonarmap.tools.files.readers.navigation.odometry import turn_rates_of
from sonarmap.tools.files.readers.pings.patches import LineReading
from sonarmap.tools.files.readers.scans import ReadScans, read_survey

_ELSEWHERE = "say where the scans are now with --scans-from PATH"


def mapped_scans(
    folder: Map, paths: Sequence[str] = (), progress: Callable[[int, int, str], None] | None = None
) -> tuple[Scan, ...]:
    """The N scans of a map as it used them: corrected and straightened likewise. Large surveys are on disk.

    Args:
        folder: the map.
        paths: the scans, as `map` took them; none for those that it was given, from the same current folder.
        progress: as of `read_survey`.

    Raises:
        InputError: the map does not say what it was made of, or its scans are gone, or changed.
    """
    settings: dict[str, Any] = folder.summary.get("settings") or {}
    inputs: list[str] | None = list(paths) or settings.get("inputs")
    if not inputs:
        raise InputError(f"{folder.path / SUMMARY} does not say where the map's scans are; {_ELSEWHERE}")
    with as_written(folder.path):
        corrections = _corrections(settings)
    try:
        read = read_survey(inputs, (), progress, corrections)
    except InputError as error:
        raise InputError(f"cannot read the scans again to get their points: {error}; {_ELSEWHERE}") from error
    _require_same(folder, read)
    with as_written(folder.path):
        return _straight(folder, read)


def _corrections(settings: dict[str, Any]) -> Corrections:
    """What `map` did to the points, as its summary has it."""
    biases = Biases.of_json(settings["patch_test"]) if "patch_test" in settings else Biases()
    frame = PointFrame(settings.get("frame", "flu"), settings.get("units", "m"))
    lines = LineReading(settings.get("patch"), biases, settings.get("draught") or 0.0)
    return Corrections(settings.get("sound_speed"), settings.get("range_scale", 1.0), frame, lines)


def _require_same(folder: Map, read: ReadScans) -> None:
    """Refuse other files than those of the map, by their SHA-256, and another number of scans."""
    known = [row["sha256"] for row in folder.summary.get("inputs") or ()]
    files = [row["sha256"] for row in input_rows(read.files)]
    if files != known[: len(files)] or len(read.scans) != len(folder.names):
        raise InputError(
            f"{read.files[0].parent} holds {len(read.scans)} scans, which are not, or no longer, the "
            f"{len(folder.names)} that {folder.path} was made of; {_ELSEWHERE}, or map again"
        )


def _straight(folder: Map, read: ReadScans) -> tuple[Scan, ...]:
    """The scans without what the sensor's motion did to them, where the map had them so."""
    if not folder.summary.get("straightened"):
        return read.scans
    if (way := folder.graph.get("straightened_by")) is None:
        raise InputError(f"{folder.path} does not say how its scans were straightened; map again with this version")
    T = RigidTransform.from_matrix(np.array(way["T_world_sensor"], np.float64))
    before = Trajectory(np.array([pose["stamp"] for pose in folder.graph["poses"]], np.float64), T)
    turn_rates = turn_rates_of(read.files, read.scans) if way["turned"] else None
    return straightened(read.scans, before, way["runs"], folder.voxel / 2, way["bent"], turn_rates).scans
