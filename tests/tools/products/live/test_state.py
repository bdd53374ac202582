"""What is said of a dive, in each status."""

import json
from typing import Any

import pytest

from sonarmap.tools.products.live.state import State

ALONE = {"scans": 1, "placed": 1, "loops": 1, "sigma": 0.072}
MANY = {"scans": 3200, "placed": 3156, "loops": 41, "parts": 2, "behind": 7, "late": 1.4, "missing": 3, "sigma": 1.26}


@pytest.mark.parametrize(
    ("status", "known", "said"),
    [
        ("waiting", {}, "Waiting for scans."),
        ("waiting", {"silent": 3.0}, "Waiting for scans."),
        (
            "waiting",
            {"silent": 7.4},
            "Waiting for scans; 0 of 0 scans placed, 0 loops, nothing has come for 7 s.",
        ),
        ("placed", {"scans": 5, "placed": 4}, "Placed; 4 of 5 scans placed, 0 loops."),
        ("placed", ALONE, "Placed to within 7 cm; 1 of 1 scans placed, 1 loop."),
        (
            "uncertain",
            MANY,
            "Placed, but only to within 1.3 m; 3,156 of 3,200 scans placed, 41 loops, 2 parts that nothing joins yet, "
            "3 shots missing, 7 scans (1 s) behind.",
        ),
        (
            "placed",
            {"scans": 9, "placed": 8, "loops": 2, "missing": 1, "behind": 1, "late": 2.6, "sigma": 0.31},
            "Placed to within 31 cm; 8 of 9 scans placed, 2 loops, 1 shot missing, 1 scan (3 s) behind.",
        ),
        (
            "placed",
            {"scans": 900, "placed": 800, "loops": 2, "behind": 256, "late": 51.2, "sigma": 0.31},
            "Placed to within 31 cm; 800 of 900 scans placed, 2 loops, 256 or more scans (51 s) behind.",
        ),
        ("placed", {"scans": 9, "placed": 8, "behind": 4, "late": 1.0}, "Placed; 8 of 9 scans placed, 0 loops."),
        (
            "lost",
            {"scans": 12, "placed": 8, "loops": 1, "lost_for": 4.3},
            "Lost for 4 s: no scan matches the map; return to the last confirmed position; 8 of 12 scans placed, "
            "1 loop.",
        ),
        (
            "lost",
            {"scans": 12, "placed": 8, "loops": 2, "parts": 2, "alone": True},
            "Lost: mapping a separate part until a known place is seen again; 8 of 12 scans placed, "
            "2 loops, 2 parts that nothing joins yet.",
        ),
        (
            "ended",
            {"scans": 12, "placed": 8, "loops": 2, "silent": 60.0},
            "The dive has ended; 8 of 12 scans placed, 2 loops.",
        ),
    ],
)
def test_each_status_in_a_sentence(status: Any, known: dict[str, Any], said: str) -> None:
    assert State(status, **known).sentence == said


def test_a_state_is_a_message_of_its_own_names() -> None:
    state = State("lost", 9, 8, 4, lost_for=7.5, pose=[1, 2, 3, 0, 0, 0.6, 0.8], sure=(1, [1, 2, 3]), alerts=("<&",))
    said = json.loads(state.message)
    assert said["kind"] == "state"
    assert said["sentence"] == state.sentence
    assert (said["status"], said["keys"], said["lost_for"], said["sure"]) == ("lost", 4, 7.5, [1, [1, 2, 3]])
    assert (said["speed"], said["alerts"]) == (None, ["<&"])


def test_a_dive_that_is_only_recorded_says_so() -> None:
    assert State("recording").sentence == "The recording goes on, and the mapping begins again."
