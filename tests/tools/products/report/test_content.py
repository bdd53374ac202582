"""Content of the page: heights and depths, the command, and the verdict."""

import shlex
from pathlib import Path
from typing import Any

import pytest

from sonarmap.tools.files.geo import Georeference
from sonarmap.tools.files.map_folder.folder import read_map_folder
from sonarmap.tools.products.report.content import content_of, verdict
from sonarmap.tools.products.report.provenance import map_command
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


MAPPER = {"loops": {"per_scan": 2}, "limits": {"speed": None, "turn_rate": None, "step": None}, "min_seen": 2}


def command_words(settings: dict[str, Any]) -> tuple[list[str], list[str]]:
    """Options after `sonarmap map`, and the inputs, as a shell splits them."""
    command = map_command(settings)
    options = shlex.split(command["options"])
    assert options[:2] == ["sonarmap", "map"]
    return options[2:], shlex.split(command["inputs"])


def test_inputs_are_quoted_and_not_taken_for_options() -> None:
    paths = ["a b.ply", "it's.ply", 'say "x".ply', "$HOME.ply", "new\nline.ply", "`x`;rm *.ply", "grün.ply", "scans/"]
    assert command_words({"inputs": paths}) == ([], paths)
    assert command_words({"inputs": "-x.ply"}) == ([], ["./-x.ply"])


def test_the_command_repeats_the_given_options_and_the_grid() -> None:
    grid = {"inputs": [], "method": "icp", "grid": {"edge": 64, "voxel": 0.1 + 0.2}, "mapper": MAPPER}
    assert command_words(grid)[0] == ["--method", "icp", "--grid", "64", "--voxel", "0.30000000000000004"]
    settings = {
        "priors": "nav log.csv",
        "nav_offset": "-1.5",
        "sound_speed": 1487.5,
        "ties": "old.csv",
        "spectral": {"hypotheses": 6},
        "mapper": MAPPER
        | {"loops": {"per_scan": 5}, "keys": {"step": 0.5}, "min_seen": 1}
        | {"limits": {"speed": 1.5, "turn_rate": 0.5235987755982988, "step": None}},
    }
    assert command_words(settings)[0] == [
        *("--priors", "nav log.csv", "--nav-offset=-1.5", "--sound-speed", "1487.5", "--loops", "5"),
        *("--max-speed", "1.5", "--max-turn-rate", "30.0", "--set", "keys.step=0.5"),
        *("--set", "min_seen=1"),
    ]


def test_the_command_repeats_the_origin_without_navigation() -> None:
    """Control points are in meters from the origin."""
    here = Georeference(-33.5, 151.25, 4.5, "MSL", 45.0)
    options = shlex.split(map_command({"inputs": []}, here)["options"])
    assert options[2:] == ["--origin=-33.5,151.25,4.5", "--vertical", "MSL", "--origin-heading", "45.0"]
    assert "--origin" not in map_command({"inputs": [], "priors": "nav.csv"}, here)["options"]


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
