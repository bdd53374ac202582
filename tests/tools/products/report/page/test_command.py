"""The command that makes a map again."""

import shlex
from typing import Any

import pytest

from sonarmap.tools.files.geo.georeference import Georeference
from sonarmap.tools.products.report.page.command import map_command

MAPPER = {"loops": {"per_scan": 2}, "limits": {"speed": None, "turn_rate": None, "step": None}, "min_seen": 2}


def words(settings: dict[str, Any]) -> tuple[list[str], list[str]]:
    """The options behind `sonarmap map`, and the inputs, as a shell divides them."""
    command = map_command(settings)
    options = shlex.split(command["options"])
    assert options[:2] == ["sonarmap", "map"]
    return options[2:], shlex.split(command["inputs"])


@pytest.mark.parametrize(
    "path", ["a b.ply", "it's.ply", 'say "x".ply', "$HOME.ply", "new\nline.ply", "`x`;rm *.ply", "grün.ply"]
)
def test_inputs_are_quoted(path: str) -> None:
    assert words({"inputs": [path, "scans/"]}) == ([], [path, "scans/"])


def test_an_input_is_no_option() -> None:
    assert words({"inputs": "-x.ply"}) == ([], ["./-x.ply"])


def test_the_grid_is_as_it_was() -> None:
    settings = {"inputs": [], "method": "icp", "grid": {"edge": 64, "voxel": 0.1 + 0.2}, "mapper": MAPPER}
    assert words(settings)[0] == ["--method", "icp", "--grid", "64", "--voxel", "0.30000000000000004"]


def test_options_that_were_given_are_given_again() -> None:
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
    assert words(settings)[0] == [
        *("--priors", "nav log.csv", "--nav-offset=-1.5", "--sound-speed", "1487.5", "--loops", "5"),
        *("--key-step", "0.5", "--max-speed", "1.5", "--max-turn-rate", "30.0", "--min-seen", "1"),
    ]


def test_the_origin_is_said_again_where_no_navigation_does() -> None:
    """As control points are in meters from it."""
    here = Georeference(-33.5, 151.25, 4.5, "MSL", 45.0)
    options = shlex.split(map_command({"inputs": []}, here)["options"])
    assert options[2:] == ["--origin=-33.5,151.25,4.5", "--vertical", "MSL", "--origin-heading", "45.0"]
    assert "--origin" not in map_command({"inputs": [], "priors": "nav.csv"}, here)["options"]
