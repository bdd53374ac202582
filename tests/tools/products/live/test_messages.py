"""Messages come back as they were meant, whatever the mapping puts in."""

import json
from struct import unpack_from

import numpy as np
import pytest

from sonarmap.tools.products.live import messages
from sonarmap.tools.products.live.messages import LastSure, State, Vehicle

TURN = (0.0, 0.0, 0.6, 0.8)


def test_points_come_back_within_half_a_quantum() -> None:
    points = np.random.default_rng(0).normal(0, 20, (500, 3))
    for kind, message in ((1, messages.cloud_message(7, points)), (2, messages.last_message(7, points))):
        assert message[:4] == bytes([kind, 0, 0, 0])
        key, quantum = unpack_from("<If", message, 4)
        back = np.frombuffer(message, "<i2", offset=12).reshape(-1, 3) * quantum
        assert key == 7
        assert np.abs(back - points).max() <= 0.51 * quantum


def test_points_that_are_far_or_not_finite_do_no_harm() -> None:
    message = messages.cloud_message(0, [[1e4, 0, 0], [np.nan, 0, 0], [-1e4, 1, np.inf]])
    assert len(message) == 12 + 6
    assert np.frombuffer(message, "<i2", offset=12).tolist() == [32767, 0, 0]
    assert len(messages.last_message(0, np.zeros((0, 3)))) == 12


def test_a_state_comes_back() -> None:
    vehicle = Vehicle(3, (1, 2, 3, *TURN), np.eye(3) / 4)
    state = State(
        "lost", "<b>", 5.0, 9, 8, 4, 1, 2, 3, 7.5, vehicle, 1, np.nan, 0.5, None, LastSure(1, (1, 2, 3)), ("&",)
    )
    said = json.loads(messages.state_message(state))
    assert said["vehicle"] == {"key": 3, "pose": [1, 2, 3, *TURN], "covariance": (np.eye(3) / 4).tolist()}
    assert said["last_sure"] == {"part": 1, "place": [1, 2, 3]}
    numbers = [said[name] for name in ("scans", "placed", "keys", "loops", "parts", "behind", "part", "lost_since")]
    assert numbers == [9, 8, 4, 1, 2, 3, 1, 7.5]
    assert (said["kind"], said["status"], said["sentence"], said["alerts"]) == ("state", "lost", "<b>", ["&"])
    assert (said["depth"], said["speed"], said["turn_rate"]) == (None, 0.5, None)


def test_texts_are_bounded() -> None:
    said = json.loads(messages.state_message(State("placed", "x" * 5000, alerts=["y" * 5000] * 100)))
    assert len(json.dumps(said)) < 5000


def test_poses_track_and_loops_come_back() -> None:
    poses = json.loads(messages.poses_message(4, [0, 1], [(1, 2, 3, *TURN)] * 2))
    assert poses == {"kind": "poses", "first": 4, "poses": [[0, 1, 2, 3, *TURN], [1, 1, 2, 3, *TURN]]}
    track = json.loads(messages.track_message([2, 3], [[0, 0, 1], [1, 0, 0]]))
    assert track == {"kind": "track", "points": [[2, 0, 0, 1], [3, 1, 0, 0]]}
    assert json.loads(messages.loops_message([]))["pairs"] == []
    assert json.loads(messages.loops_message([(1, 9)]))["pairs"] == [[1, 9]]


def test_a_pose_that_is_not_finite_is_refused() -> None:
    with pytest.raises(ValueError, match="not finite"):
        messages.poses_message(0, [0], [(np.nan, 2, 3, *TURN)])


def test_coverage_comes_back_and_is_made_coarser_where_it_is_large() -> None:
    counts = np.array([[0, 1, 300], [2, 3, 4]])
    message = messages.coverage_message(counts, 0.5, (-1.0, 2.0), 6)
    assert unpack_from("<B3xIIfffI", message) == (3, 3, 2, 0.5, -1.0, 2.0, 6)
    assert list(message[28:]) == [0, 1, 255, 2, 3, 4]
    large = messages.coverage_message(np.eye(1001, dtype=int), 0.5, (0, 0), 0)
    _, width, height, cell, *_ = unpack_from("<B3xIIfffI", large)
    assert (width, height, cell) == (501, 501, 1.0) or (width, height, cell) == (251, 251, 2.0)
    assert len(large) == 28 + width * height
    with pytest.raises(ValueError, match="counts"):
        messages.coverage_message(np.zeros(5), 1.0, (0, 0), 0)
