"""The store of messages: late and slow browsers get what they lack, without growing memory."""

import json

import numpy as np
from scipy.spatial.transform import RigidTransform

from sonarmap.slam.live.growing import Pose
from sonarmap.tools.products.live import messages
from sonarmap.tools.products.live.messages import Kept

POSE = Pose(0, RigidTransform.identity(), np.zeros((6, 6)))


def all_after(store: Kept, reached: dict[type, int]) -> tuple[list[str], list[bytes]]:
    """Texts and binary messages until the store has no more."""
    texts, binaries = list[str](), list[bytes]()
    while new := store.after(reached):
        texts += [each for each in new if isinstance(each, str)]
        binaries += [each for each in new if isinstance(each, bytes)]
    return texts, binaries


def filled(keys: int = 50) -> Kept:
    store = Kept()
    for key in range(keys):
        for each in messages.poses(key, [POSE] * (key + 1)):
            store.add(each)
        store.add(messages.cloud(key, np.full((10, 3), float(key))))
        store.add(messages.last(key, np.ones((5, 3))))
        store.add(("state", f'{{"kind":"state","sentence":"{key}"}}'))
    return store


def test_a_late_browser_gets_everything_and_then_only_news() -> None:
    store, reached = filled(), dict[type, int]()
    texts, binaries = all_after(store, reached)
    assert [json.loads(each)["kind"] for each in texts] == ["poses", "state"]
    assert len(json.loads(texts[0])["poses"]) == 50
    assert [each[0] for each in binaries] == [messages.CLOUD] * 50 + [messages.LAST]
    assert store.after(reached) == []
    store.add(messages.loops([]))
    assert all_after(store, reached) == ([messages.loops([])[1]], [])


def test_unchanged_poses_are_not_sent_again() -> None:
    store, reached = filled(), dict[type, int]()
    all_after(store, reached)
    for each in messages.poses(0, [POSE] * 50):
        store.add(each)
    assert store.after(reached) == []


def test_a_slow_browser_gets_only_the_latest_messages() -> None:
    store = Kept()
    for k in range(1000):
        store.add(messages.last(0, np.full((100, 3), float(k))))
        store.add(("state", f"{k}"))
    assert store.after({}) == ["999", messages.last(0, np.full((100, 3), 999.0))[1]]


def test_texts_are_sent_before_clouds() -> None:
    store, reached = filled(), dict[type, int]()
    first = store.after(reached)
    assert sum(isinstance(message, bytes) for message in first) == messages.AT_ONCE
    store.add(("state", "lost"))
    assert store.after(reached)[0] == "lost"


def test_a_reset_is_sent_and_drops_earlier_messages() -> None:
    store, reached = filled(), dict[type, int]()
    store.after(reached)
    store.add(messages.RESET)
    store.add(messages.loops([]))
    assert store.after(reached) == [messages.RESET[1], messages.loops([])[1]]
