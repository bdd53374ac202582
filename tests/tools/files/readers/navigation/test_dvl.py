"""Reports of Water Linked DVLs as dead reckoning; the sentences with checksums are those of the maker's pages."""

import json
from pathlib import Path

import numpy as np
import pytest

from sonarmap.tools.files.readers.instruments import values_of
from sonarmap.tools.files.readers.navigation.odometry import read_odometry
from sonarmap.tools.files.readers.navigation.overview import is_log, read_navigation
from sonarmap.tools.files.readers.navigation.settings import NavigationSettings
from tests.samples.refusals import refuses
from tests.tools.files.readers.navigation.logs import START, read, scans_at

PUBLISHED = """wrp,49056.809,0.41,0.15,1.23,0.4,53.9,13.0,19.3,0*de
wrp,49057.269,0.39,0.18,1.23,0.4,53.9,13.0,19.3,0*e2
wrp,49058.269,0.39,0.18,1.23,0.4,53.9,13.0,19.3,1*e5
"""


def crc8(content: str) -> str:
    crc = 0
    for byte in content.encode():
        crc ^= byte
        for _ in range(8):
            crc = (crc << 1) ^ 0x107 if crc & 0x80 else crc << 1
    return f"{content}*{crc:02x}"


def poses(count: int = 40) -> list[dict[str, float]]:
    """Five a second: 0.1 m forward and 0.05 m to the right each, sinking and turning slowly."""
    return [
        {
            "ts": START + 0.2 * k, "x": 0.1 * k, "y": 0.05 * k, "z": 0.01 * k, "std": 0.002 + 0.004 * k,
            "roll": 1.5, "pitch": -2.5, "yaw": (350 + k) % 360 - 180.0, "status": 0,
        }
        for k in range(count)
    ]  # fmt: skip


def json_lines() -> str:
    lines = []
    for k, pose in enumerate(poses()):
        lines.append(json.dumps({**pose, "type": "position_local", "format": "json_v3.1"}))
        velocity = {"time": 106.39, "vx": 0.5, "vy": 0.25, "vz": 0.05, "fom": 0.002, "altitude": 4.9}
        lines.append(json.dumps({**velocity, "velocity_valid": k % 8 > 0, "status": 0, "type": "velocity"}))
    return "\n".join([*lines, ""])


def serial_lines() -> str:
    lines = []
    for k, pose in enumerate(poses()):
        lines.append(crc8("wrp," + ",".join(f"{pose[name]:.3f}" for name in list(pose)[:-1]) + ",0"))
        valid = "y" if k % 8 else "n"
        lines.append(crc8(f"wrz,0.500,0.250,0.050,{valid},4.90,0.002,1e-07;0;0;0;1e-07;0;0;0;1e-07,7,14,123.00,0"))
    return "\r\n".join([*lines, ""])


@pytest.mark.parametrize("text", [json_lines(), serial_lines()], ids=["json", "serial"])
def test_positions_are_dead_reckoning_with_their_figure_of_merit(path: Path, text: str) -> None:
    path.write_text(text)
    assert is_log(path)
    notes = list[str]()
    found = read_odometry(path, scans_at(START + 1, START + 3.1, START + 7), 0.01, 0.001, notes)
    values = values_of(found.T_odom_sensor)
    k = np.array([5, 15.5, 35])
    np.testing.assert_allclose(values[:, 3:], np.column_stack([0.05 * k, 0.1 * k, 0.01 * k]), atol=1e-3)  # East, North
    np.testing.assert_allclose(values[:, 2], (350 + k - 180) % 360, atol=0.02)
    np.testing.assert_allclose(values[:, :2], [[1.5, -2.5]] * 3, atol=0.02)
    assert found.drift == pytest.approx(0.004 / np.linalg.norm([0.1, 0.05, 0.01]), rel=1e-3)
    said = "\n".join(notes)
    assert "40 positions, 35 velocities, 5 invalid reports" in said
    assert "grows by 3.6% of the distance" in said


def test_published_sentences_have_the_right_checksums(path: Path) -> None:
    path.write_text(PUBLISHED.replace("*e5", "*e4"))
    notes = list[str]()
    log = read_navigation(path, NavigationSettings(), None, np.zeros(0), notes)
    np.testing.assert_allclose(log.times, [49056.809, 49057.269])
    np.testing.assert_allclose(log.values[0], [53.9, 13, 19.3, 0.15, 0.41, 1.23])
    np.testing.assert_allclose(log.sigmas[:, 3:], 0.4)
    assert "2 positions, 1 damaged ones" in notes[0]


def test_a_log_without_positions_or_with_a_reset_is_refused(path: Path) -> None:
    velocities = "\n".join(line for line in serial_lines().splitlines() if line.startswith("wrz"))
    path.write_text(velocities)
    refuses(
        "35 velocities, 5 invalid.*record the DVL's position_local", read_odometry, path, scans_at(START), 0.01, 0.1
    )
    path.write_text(json_lines() + json_lines().replace(str(int(START)), str(int(START) + 60)))
    refuses("line 81: the dead reckoning was reset", read_odometry, path, scans_at(START, START + 1), 0.01, 0.001)
    refuses("give it by --odometry", read, path, json_lines())
