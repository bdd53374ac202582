"""Clouds with z up and z down, over a bed, along a wall and under a hull: never a map upside down with exit code 0."""

from pathlib import Path

import pytest

from tests.samples.bags.upside_down import bag
from tests.samples.clutter_scans import sonarmap

SCENES = ("bed", "wall", "hull")
SIGMAS = ("--prior-sigmas", "1,3,0.1,1")


def code(folder: Path, *options: str, priors: bool) -> int:
    """The exit code of `map`."""
    given = ("--priors", folder / "priors.csv", *SIGMAS) if priors else ()
    out = folder / f"map{''.join(options)}{priors}"
    return sonarmap("map", folder / "dive", "-o", out, "--grid", "64", "--no-report", *options, *given).exit_code


@pytest.mark.parametrize("down", [False, True])
@pytest.mark.parametrize("name", SCENES)
def test_the_makers_layout_is_asked_for(tmp_path: Path, name: str, down: bool) -> None:
    """With and without priors, as neither a flat bed nor a wall nor a hull shows the axes."""
    bag(tmp_path, name, down)
    assert [code(tmp_path, priors=priors) for priors in (False, True)] == [2, 2]


def test_a_bed_above_the_sonar_is_never_right(tmp_path: Path) -> None:
    """Though --frame says so; a map of the same scans with the other axes is whole."""
    bag(tmp_path, "bed", down=True)
    assert [code(tmp_path, "--frame", axes, priors=True) for axes in ("flu", "frd")] == [3, 0]
    assert code(tmp_path, "--frame", "flu", "--no-check-priors", priors=True) == 0


@pytest.mark.slow
@pytest.mark.parametrize("moves", [False, True])
@pytest.mark.parametrize("down", [False, True])
@pytest.mark.parametrize("name", SCENES)
def test_maps_with_the_right_axes_are_whole_and_with_others_are_not(
    tmp_path: Path, name: str, down: bool, moves: bool
) -> None:
    """In a frame that asks nothing. Level at one depth, a wall and a hull show nothing: a map of a hull is doubted with
    the right axes, and one of a wall with none."""
    bag(tmp_path, name, down, moves, frame="sonar_link")
    right, wrong = ("frd", "flu") if down else ("flu", "frd")
    expected = {"bed": [0, 3], "wall": [0, 0], "hull": [3, 0]}[name] if not moves else [0, 3]
    assert [code(tmp_path, "--frame", axes, priors=True) for axes in (right, wrong)] == expected
