"""A map in a sentence, by hand."""

from typing import Any

import pytest

from sonarmap.tools.products.report.page.verdict import verdict

NAMES = [f"dive#{k}" for k in range(9)]


def summary(**changes: Any) -> dict[str, Any]:
    """Of nine scans in one map, all well."""
    return {
        "unplaced": [],
        "components": [{"map": {"seen_by_two_or_more": 0.8}}],
        "pairs": {"by_role": {"sequential": {"tried": 8, "kept": 8}, "loop": {"tried": 3, "kept": 2}}},
        "crossing_error_m": {"pairs": 4, "before": 0.512, "after": 0.0731},
        "by_navigation": [],
        "unread": [],
        "gaps": [],
        "wrong_fixes": [],
        "graph": {"converged": True},
    } | changes


def test_all_is_well() -> None:
    judged = verdict(summary(), NAMES)
    assert judged.sentence == (
        "All 9 scans lie in one map; 2 of 3 loops were kept; where the track crosses itself scans lie 0.073 m "
        "apart (0.51 m before the loops)."
    )
    assert judged.concerns == ()


def test_without_loops_and_crossings() -> None:
    judged = verdict(summary(pairs={"by_role": {}}, crossing_error_m={"pairs": 0}), NAMES)
    assert judged.sentence == "All 9 scans lie in one map; no loops were tried."


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"components": [{"map": {"seen_by_two_or_more": 0.8}}] * 3}, "3 separate maps, each in a frame of its own"),
        ({"unplaced": [2, 7]}, "2 scans in no map: no reliable registration joins them to the others: dive#2, dive#7."),
        ({"by_navigation": [4]}, "1 scan placed by navigation alone"),
        ({"unread": [{"name": "bad.ply"}]}, "1 scan could not be read: bad.ply."),
        ({"gaps": [[3, 4], [None, 0]]}, "2 gaps between consecutive scans: dive#3 to dive#4, ? to dive#0."),
        ({"wrong_fixes": [{"name": "dive#5", "kind": "depth", "sigmas": 11.26}]}, "depth of dive#5 is 11.3 standard"),
        ({"graph": {"converged": False}}, "stopped before it converged"),
        ({"components": [{"map": {"seen_by_two_or_more": 0.25}}]}, "Only 25% of the map was seen by more than one"),
    ],
)
def test_concerns(changes: dict[str, Any], words: str) -> None:
    (concern,) = verdict(summary(**changes), NAMES).concerns
    assert words in concern


def test_many_names_are_counted() -> None:
    judged = verdict(summary(unplaced=list(range(8))), NAMES)
    assert judged.sentence.startswith("1 of 9 scans lie")
    assert "dive#4 and 3 more." in judged.concerns[0]
