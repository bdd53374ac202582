"""Content of the page: heights and depths, and the verdict."""

from pathlib import Path
from typing import Any

import pytest

from sonarmap.tools.files.geo import Georeference
from sonarmap.tools.files.map_folder.folder import read_map_folder
from sonarmap.tools.products.report.content import content_of, verdict
from tests.tools.products.export.finished import finished_map

HEIGHT = "height over the first scan"


@pytest.mark.parametrize(
    ("here", "label", "zero"),
    [
        (None, HEIGHT, None),
        (Georeference(60.0, 5.0), HEIGHT, None),  # no height reference
        (Georeference(60.0, 5.0, -4.5, "MSL"), "depth below mean sea level", 4.5),
    ],
)
def test_depths_need_a_datum(tmp_path: Path, here: Georeference | None, label: str, zero: float | None) -> None:
    (part,) = content_of(read_map_folder(finished_map(tmp_path, georeference=here))).shown["parts"]
    assert (part["height"]["label"], part["height"]["zero"]) == (label, zero)
    assert part["on_earth"] == (here is not None)
    assert part["axes"] == ["x", "y", "z"]


NAMES = [f"dive#{k}" for k in range(9)]


WELL: dict[str, Any] = {"map": {"seen_by_two_or_more": 0.8}, "scans": list(range(9)), "unmeasured": []}


def summary(**changes: Any) -> dict[str, Any]:
    """Summary of nine scans in one map, without faults."""
    return {
        "unplaced": [],
        "components": [WELL],
        "scans": [{"sigmas": {"rotation_deg": 0.2 * k}} for k in range(9)],
        "pairs": {"by_role": {"sequential": {"tried": 8, "kept": 8}, "loop": {"tried": 3, "kept": 2}}},
        "crossing_error_m": {"pairs": 4, "before": 0.512, "after": 0.0731},
        "unread": [],
        "warnings": [],
    } | changes


def test_incomplete_or_wrong_navigation_is_in_the_first_sentence() -> None:
    unknown = WELL | {"unmeasured": ["tilt_x", "tilt_y", "heading"]}
    assert "tilt is not known" in verdict(summary(components=[unknown]), NAMES)["sentence"]
    reason = "depths err 3.1 times as much"
    judged = verdict(summary(contradictions=[reason], warnings=[reason]), NAMES)
    assert judged["sentence"].startswith("Depths err 3.1 times as much. All 9 scans")
    assert judged["concerns"] == []


@pytest.mark.parametrize(
    ("changes", "concern"),
    [
        ({"warnings": ["gap between a and b: take it out of `ties`"]}, "Gap between a and b: take it out of ties."),
        ({"unread": [{"name": f"dive#{k}"} for k in range(6)]}, "6 scans could not be read: dive#0, dive#1, "),
        ({"components": [WELL | {"map": {"seen_by_two_or_more": 0.2}}]}, "Only 20% of the map was seen by more"),
    ],
)
def test_each_fault_is_a_concern(changes: dict[str, Any], concern: str) -> None:
    assert verdict(summary(), NAMES)["concerns"] == []
    (text,) = verdict(summary(**changes), NAMES)["concerns"]
    assert text.startswith(concern)
