"""What is said of a dive, in each status."""

import json
from typing import Any

import pytest

from sonarmap.tools.products.live.messages import State


@pytest.mark.parametrize(
    ("status", "known", "said"),
    [
        ("waiting", {"silent": 7.4}, ("Waiting for scans", "nothing has come for 7 s")),
        (
            "uncertain",
            {"scans": 3200, "placed": 3156, "parts": 2, "behind": 7, "late": 1.4, "missing": 3, "sigma": 1.26},
            ("only to within 1.3 m", "3,156 of 3,200", "2 parts", "3 shots missing", "7 scans (1 s) behind"),
        ),
        ("lost", {"scans": 12, "placed": 8, "lost_for": 4.3}, ("Lost for 4 s", "return to the last", "8 of 12")),
        ("ended", {"scans": 12, "placed": 8}, ("The dive has ended",)),
        ("recording", {}, ("The recording goes on",)),
    ],
)
def test_each_status_says_what_is_known(status: Any, known: dict[str, Any], said: tuple[str, ...]) -> None:
    assert [words for words in said if words in State(status, **known).sentence] == [*said]


def test_a_state_is_a_message_of_its_own_names() -> None:
    state = State("lost", 9, 8, 4, lost_for=7.5, pose=[1, 2, 3, 0, 0, 0.6, 0.8], sure=(1, [1, 2, 3]), alerts=("<&",))
    said = json.loads(state.message)
    assert said["kind"] == "state"
    assert said["sentence"] == state.sentence
    assert (said["status"], said["keys"], said["lost_for"], said["sure"]) == ("lost", 4, 7.5, [1, [1, 2, 3]])
    assert (said["speed"], said["alerts"]) == (None, ["<&"])
