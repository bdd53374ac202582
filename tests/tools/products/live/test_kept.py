"""A browser that comes late, or is slow, gets what it lacks, and costs no memory."""

import json
from struct import unpack_from
from typing import Any

import numpy as np
import pytest

from sonarmap.tools.products.live import kept, messages
from sonarmap.tools.products.live.kept import Kept, Reached
from sonarmap.tools.products.live.messages import State

POSE = (0, 0, 0, 0, 0, 0, 1)


def all_after(store: Kept, reached: Reached) -> tuple[dict[str, Any], list[bytes]]:
    """The last text of every kind, and all bytes, until nothing is left."""
    texts, binaries = {}, []
    while new := store.after(reached):
        for message in new:
            if isinstance(message, str):
                texts[json.loads(message)["kind"]] = json.loads(message)
            else:
                binaries.append(message)
    return texts, binaries


def filled(keys: int = 50, points: int = 10) -> Kept:
    store = Kept()
    for key in range(keys):
        store.add(messages.poses_message(key, [0], [POSE]))
        store.add(messages.cloud_message(key, np.full((points, 3), float(key))))
        store.add(messages.last_message(key, np.ones((5, 3))))
        store.add(messages.track_message([key], [[0, 0, 0]]))
        store.add(messages.state_message(State("placed", f"{key}")))
    return store


def test_who_comes_late_gets_everything_and_then_only_what_is_new() -> None:
    store, reached = filled(), Reached()
    texts, binaries = all_after(store, reached)
    assert texts["state"]["sentence"] == "49"
    assert (len(texts["poses"]["poses"]), len(texts["track"]["points"])) == (50, 50)
    assert [message[0] for message in binaries].count(messages.CLOUD) == 50
    assert [message[0] for message in binaries].count(messages.LAST) == 1
    assert store.after(reached) == []
    store.add(messages.poses_message(50, [0], [POSE]))
    store.add(messages.track_message([50], [[1, 0, 0]]))
    texts, binaries = all_after(store, reached)
    assert (texts["poses"]["first"], len(texts["poses"]["poses"])) == (50, 1)
    assert (texts["track"]["first"], texts["track"]["points"]) == (50, [[50, 1, 0, 0]])
    assert not binaries


def test_all_poses_come_anew_when_a_loop_closes() -> None:
    store, reached = filled(), Reached()
    all_after(store, reached)
    store.add(messages.poses_message(0, [1] * 50, [POSE] * 50))
    texts, binaries = all_after(store, reached)
    assert (texts["poses"]["first"], {row[0] for row in texts["poses"]["poses"]}) == (0, {1})
    assert not binaries
    with pytest.raises(ValueError, match="only 50"):
        store.add(messages.poses_message(60, [0], [POSE]))


def test_a_slow_browser_gets_the_latest_alone() -> None:
    store, reached = Kept(), Reached()
    for k in range(1000):
        store.add(messages.last_message(0, np.full((100, 3), float(k))))
        store.add(messages.state_message(State("placed", f"{k}")))
    texts, binaries = all_after(store, reached)
    assert texts["state"]["sentence"] == "999"
    assert len(binaries) == 1


def test_texts_do_not_wait_for_clouds() -> None:
    store, reached = filled(), Reached()
    first = store.after(reached)
    assert sum(isinstance(message, bytes) for message in first) == kept.AT_ONCE
    store.add(messages.state_message(State("lost", "now")))
    assert json.loads(store.after(reached)[0])["sentence"] == "now"


def test_beyond_the_bound_all_clouds_are_thinned_evenly(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(kept, "MOST_POINTS", 1000)
    monkeypatch.setattr(kept, "MOST_TRACK", 40)
    store = filled(keys=100, points=64)
    texts, binaries = all_after(store, Reached())
    clouds = {unpack_from("<I", message, 4)[0]: len(message) for message in binaries if message[0] == messages.CLOUD}
    assert len(clouds) == 100
    assert {(length - 12) // 6 for length in clouds.values()} == {8}
    assert 20 <= len(texts["track"]["points"]) <= 40
    assert texts["track"]["first"] == 0


def test_a_reset_forgets_everything_and_says_so() -> None:
    store, reached = filled(), Reached()
    store.after(reached)
    store.add(messages.reset_message())
    store.add(messages.poses_message(0, [0], [POSE]))
    store.add(messages.track_message([0], [[0, 0, 0]]))
    assert [json.loads(message)["kind"] for message in store.after(reached)] == ["reset", "poses", "track"]


@pytest.mark.parametrize("message", ['{"kind":"script"}', b"\x09aaaa"])
def test_what_the_page_does_not_know_is_refused(message: str | bytes) -> None:
    with pytest.raises(ValueError, match="does not know"):
        Kept().add(message)
