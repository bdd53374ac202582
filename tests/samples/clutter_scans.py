"""Boxes strewn about, seen from known poses: small scans as files, and the command line run on them in process."""

import csv
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation
from typer.testing import CliRunner, Result

from sonarmap.tools.command.main import app
from sonarmap.tools.files.writers.points import write_ply

# Of the scans of one scene, in order: p_world = T_world_sensor p_sensor [m]
T_WORLD_SENSOR = RigidTransform.from_components(
    np.array([[0.0, 0.0, 0.0], [1.5, -0.8, 0.3], [2.2, 0.9, -0.4], [3.1, 0.2, 0.1]]),
    Rotation.from_euler("ZYX", [[0, 0, 0], [14, 3, -5], [-9, -4, 6], [21, 2, 4]], degrees=True),
)


def clutter(scene: int = 1, boxes: int = 60) -> np.ndarray:
    """Points (7200, 3) float32 [m, world] on the faces of boxes; each number gives another scene."""
    rng = np.random.default_rng(scene)
    centers = rng.uniform(-8, 8, (boxes, 1, 3)) * [1, 1, 0.4]
    sides = rng.uniform(0.3, 2.0, (boxes, 1, 3))
    points = rng.uniform(-1, 1, (boxes, 120, 3))
    face = rng.integers(0, 3, (boxes, 120, 1))
    np.put_along_axis(points, face, np.sign(np.take_along_axis(points, face, 2)), 2)
    return (centers + sides * points).reshape(-1, 3).astype(np.float32)


def scan(pose: int, scene: int = 1) -> np.ndarray:
    """Points (7200, 3) float32 [m] of a scene, in the frame of the sensor at this pose of T_WORLD_SENSOR."""
    return T_WORLD_SENSOR[pose].inv().apply(clutter(scene).astype(np.float64)).astype(np.float32)


def plane() -> np.ndarray:
    """Points (2000, 3) float32 [m], all in one plane."""
    points = np.random.default_rng(5).uniform(-8, 8, (2000, 3))
    points[:, 2] = 0.3 * points[:, 0] - 0.2 * points[:, 1] + 1
    return points.astype(np.float32)


def write(folder: Path, **clouds: np.ndarray) -> list[str]:
    """Write each cloud to `folder`/name.ply, and return the paths."""
    for name, points in clouds.items():
        write_ply(folder / f"{name}.ply", points)
    return [str(folder / f"{name}.ply") for name in clouds]


def sonarmap(*arguments: str | Path) -> Result:
    """Run the command in this process, on a wide page."""
    return CliRunner(env={"COLUMNS": "300", "TERMINAL_WIDTH": "300"}).invoke(app, [str(a) for a in arguments])


def printed_at(columns: int, *arguments: str | Path) -> list[str]:
    """Lines of stdout on a terminal of this many columns."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("sonarmap.tools.command.terminal.result_width", lambda: columns)
        return CliRunner().invoke(app, [str(a) for a in arguments]).stdout.splitlines()


def files_in(folder: Path) -> dict[str, bytes]:
    """Everything in a folder, hidden files too."""
    return {path.name: path.read_bytes() for path in folder.iterdir()}


def table_of(path: Path) -> list[dict[str, str]]:
    """The rows of a CSV file, keyed by column names."""
    with path.open(newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file, strict=True))


def refused_with_reason(result: Result) -> None:
    """Check that a command refused what it was given: exit code 2, and on stdout nothing, or with --json the reason."""
    assert result.exit_code == 2
    if result.stdout:
        failure = json.loads(result.stdout)
        assert failure == {"error": failure["error"], "exit_code": 2}
        assert " ".join(failure["error"].split()) in " ".join(result.stderr.split())


def refused(result: Result, *words: str) -> None:
    """Check that a command refused what it was given, in these words."""
    refused_with_reason(result)
    said(result, *words)


def done(result: Result) -> Result:
    """Check that a command ended with exit code 0, and return its result."""
    assert result.exit_code == 0, result.stderr
    return result


def printed(result: Result, exit_code: int = 0) -> Any:
    """What a command printed as strict JSON when it ended with this code."""
    assert result.exit_code == exit_code, result.stderr
    return strict_json(result.stdout)


def strict_json(text: str) -> Any:
    """The value of JSON, which must not contain NaN or infinity."""

    def refuse(constant: str) -> None:
        raise AssertionError(f"{constant} is no JSON")

    return json.loads(text, parse_constant=refuse)


def said(result: Result, *words: str) -> None:
    """Check that stderr contains all of these words, wherever its lines break."""
    message = " ".join(result.stderr.replace("│", " ").split())
    missing: Sequence[str] = [word for word in words if word not in message]
    assert not missing, f"{missing} not in: {message}"
