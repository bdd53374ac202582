"""Messages to the live page: points, poses, coverage plan, loops and state."""

import json
from base64 import b64decode
from io import BytesIO
from struct import unpack_from
from typing import Any

import numpy as np
import pytest
from PIL import Image
from scipy.spatial.transform import RigidTransform, Rotation

from sonarmap.slam.live.growing import Pose
from sonarmap.tools.products.live import messages
from sonarmap.tools.products.live.messages import State, coverage

T = RigidTransform.from_components([1.0, 2.0, 3.0], Rotation.from_quat([0.0, 0.0, 0.6, 0.8]))
SEVEN = [1, 2, 3, 0, 0, 0.6, 0.8]


def test_points_are_decoded_within_half_a_quantum() -> None:
    points = np.random.default_rng(0).normal(0, 20, (500, 3))
    for kind, (name, message) in ((1, messages.cloud(7, points)), (2, messages.last(7, points))):
        assert isinstance(message, bytes)
        assert name == {1: "cloud 7", 2: "last"}[kind]
        assert message[:4] == bytes([kind, 0, 0, 0])
        key, quantum = unpack_from("<If", message, 4)
        back = np.frombuffer(message, "<i2", offset=12).reshape(-1, 3) * quantum
        assert key == 7
        assert np.abs(back - points).max() <= 0.51 * quantum


def test_poses_are_sent_in_blocks_from_the_first_change() -> None:
    block = messages.BLOCK
    covariance = np.diag([1.0, 1.0, 1.0, 0.01, 0.04, 0.01])
    poses = [*[Pose(0, T, covariance)] * (2 * block), Pose(1, T, covariance)]
    sent = dict(messages.poses(block + 3, poses))
    assert list(sent) == [f"poses {block}", f"poses {2 * block}"]
    assert json.loads(sent[f"poses {2 * block}"]) == {"kind": "poses", "first": 2 * block, "poses": [[1, 0.2, *SEVEN]]}
    assert len(json.loads(sent[f"poses {block}"])["poses"]) == block


def plan_of(seen: list[np.ndarray], cell: float = 0.5) -> tuple[dict[str, object], np.ndarray]:
    """A plan, and the kinds of its cells with the smallest y first."""
    name, text = coverage(seen, cell, 6)
    plan = json.loads(text)
    assert (name, plan["part"]) == ("coverage 6", 6)
    picture = Image.open(BytesIO(b64decode(plan["picture"].removeprefix("data:image/png;base64,"))))
    return plan, np.asarray(picture)[::-1]


def test_the_plan_counts_views_and_marks_holes() -> None:
    x, y = np.meshgrid(np.arange(8), np.arange(6))
    ring = np.column_stack([x.ravel(), y.ravel()])
    inside = (ring[:, 0] > 1) & (ring[:, 0] < 5) & (ring[:, 1] > 1) & (ring[:, 1] < 4)
    cells = ring[~inside]
    twice = np.repeat(cells + 0.5, 2, axis=0) * 0.5 + [-1.0, 2.0]
    once = np.repeat([[0.5, 0.5]], 2, axis=0) * 0.5 + [-1.0, 2.0]
    stray = np.array([[2.25, 4.75]])
    plan, kinds = plan_of([twice, once, stray])
    assert plan["corner"] == [-1.0, 2.0]
    assert plan["size"] == [4.0, 3.0]
    assert kinds[0, 0] == 2
    assert kinds[0, 1] == kinds[5, 7] == 3
    assert (kinds == 4).sum() == 6
    legend = plan["legend"]
    assert isinstance(legend, list)
    assert [row[1:] for row in legend][1:] == [["2 or 3 times", 0.25], ["once", 0.25 * 41], ["holes, never seen", 1.5]]
    assert plan["holes"] == []  # a narrow one


def test_the_plan_names_the_middles_of_wide_holes() -> None:
    x, y = np.meshgrid(np.arange(20), np.arange(9))
    cells = np.column_stack([x.ravel(), y.ravel()])
    holes = [
        (cells >= low).all(axis=1) & (cells < high).all(axis=1) for low, high in (([1, 2], [6, 7]), ([9, 1], [12, 4]))
    ]
    seen = np.repeat(cells[~np.any(holes, axis=0)] + 0.5, 2, axis=0) * 0.5 + [-1.0, 2.0]
    plan, _ = plan_of([seen])
    assert plan["holes"] == [[4.25, 3.25], [0.75, 4.25]] or plan["holes"] == [[0.75, 4.25], [4.25, 3.25]]


def test_a_large_plan_is_coarser_and_strays_do_not_enlarge_it() -> None:
    rng = np.random.default_rng(0)
    points = np.repeat(rng.uniform(0, 3000, (2000, 2)), 2, axis=0)
    plan, kinds = plan_of([points])
    assert max(kinds.shape) <= 1001
    assert np.allclose(plan["size"], 3000, atol=20)
    near = np.repeat(rng.uniform(0, 20, (5000, 2)), 2, axis=0)
    plan, kinds = plan_of([near, np.full((2, 2), 1e5)])
    assert max(kinds.shape) < 50


def test_a_plan_of_a_single_point_is_empty() -> None:
    _, kinds = plan_of([np.zeros((0, 2)), np.array([[1.0, 2.0]])])
    assert kinds.tolist() == [[0]]


def test_distant_points_have_a_coarser_quantum() -> None:
    _, message = messages.cloud(0, np.array([[1e4, 0, 0]]))
    assert isinstance(message, bytes)
    assert np.frombuffer(message, "<i2", offset=12).tolist() == [32767, 0, 0]
    assert len(messages.last(0, np.zeros((0, 3)))[1]) == 12


@pytest.mark.parametrize(
    ("status", "known", "phrases"),
    [
        ("waiting", {"silent": 7.4}, ("Waiting for scans", "nothing has come for 7 s")),
        (
            "uncertain",
            {"scans": 3200, "placed": 3156, "parts": 2, "behind": 7, "late": 1.4, "missing": 3, "sigma": 1.26},
            ("only to within 1.3 m", "3,156 of 3,200", "2 parts", "3 shots missing", "7 scans (1 s) behind"),
        ),
        ("lost", {"scans": 12, "placed": 8, "lost_for": 4.3}, ("Lost for 4 s", "return to the last", "8 of 12")),
    ],
)
def test_each_status_states_the_known_values(status: Any, known: dict[str, Any], phrases: tuple[str, ...]) -> None:
    assert [words for words in phrases if words in State(status, **known).sentence] == [*phrases]


def test_a_state_message_has_the_fields_of_the_state() -> None:
    state = State("lost", 9, 8, 4, lost_for=7.5, pose=[1, 2, 3, 0, 0, 0.6, 0.8], sure=(1, [1, 2, 3]), alerts=("<&",))
    sent = json.loads(state.message)
    assert sent["kind"] == "state"
    assert sent["sentence"] == state.sentence
    assert (sent["status"], sent["keys"], sent["lost_for"], sent["sure"]) == ("lost", 4, 7.5, [1, [1, 2, 3]])
    assert (sent["ahead"], sent["alerts"]) == (None, ["<&"])
