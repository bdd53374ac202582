"""Sections of known points, by hand."""

from pathlib import Path

import numpy as np
import pytest

from sonarmap.tools.files.geo import Georeference, Projection
from sonarmap.tools.products.section import (
    PROFILE,
    Coordinates,
    Section,
    Titles,
    profile_of,
    section_figure,
    section_of,
    write_section,
)
from tests.samples.clutter_scans import files_in, table_of
from tests.tools.products.section.made_up import placed

# From (1, 1) 5 m in the direction (0.6, 0.8); the last three points are not in the section
LINE = np.array([[1.0, 1.0], [4.0, 5.0]])
POINTS = np.array(
    [
        [2.2, 2.6, -3.0],  # 2 m along, on the line
        [1.0, 1.0, -7.0],  # its start
        [1.0 + 0.6 * 0.5 - 0.8 * 0.9, 1.0 + 0.8 * 0.5 + 0.6 * 0.9, -5.0],  # 0.5 m along, 0.9 m to the left
        [1.0 + 0.6 * 2.5 + 0.8 * 0.4, 1.0 + 0.8 * 2.5 - 0.6 * 0.4, -4.0],  # 2.5 m along, 0.4 m to the right
        [1.0 - 0.06, 1.0 - 0.08, -1.0],  # 0.1 m before the start
        [4.06, 5.08, -1.0],  # 0.1 m beyond the end
        [2.2 - 0.8 * 1.1, 2.6 + 0.6 * 1.1, -1.0],  # 1.1 m beside
    ]
)
SIGMA = np.array([0.4, 0.1, 0.2, 0.3, 9, 9, 9])
HERE = Georeference(60.0, 9.0, height=2.0)


def section(georeference: Georeference | None = None) -> Section:
    return section_of(placed(POINTS, SIGMA, georeference=georeference), LINE, 1.0, Coordinates())


def test_a_section_has_the_points_near_its_line() -> None:
    cut = section()
    assert cut.length == pytest.approx(5)
    np.testing.assert_allclose(cut.distance, [0, 0.5, 2, 2.5], atol=1e-12)
    np.testing.assert_allclose(cut.offset, [0, 0.9, 0, -0.4], atol=1e-12)
    np.testing.assert_array_equal(cut.height, [-7, -5, -3, -4])
    np.testing.assert_allclose(cut.sigma, [0.1, 0.2, 0.4, 0.3])
    np.testing.assert_array_equal(section(HERE).height, [-5, -3, -1, -2])  # the origin is 2 m up


def test_the_profile_has_the_median_of_every_cell() -> None:
    profile = profile_of(section(), 2.0)
    np.testing.assert_allclose(profile.distance, [1, 3])  # the last cell, from 4 m to 5 m, is empty
    np.testing.assert_allclose(profile.height, [-6, -3.5])
    np.testing.assert_allclose(profile.lowest, [-7, -4])
    np.testing.assert_allclose(profile.highest, [-5, -3])
    np.testing.assert_allclose(profile.sigma, [0.15, 0.35])
    np.testing.assert_allclose(profile.place, [[1.6, 1.8], [2.8, 3.4]])
    assert profile.count.tolist() == [2, 2]
    whole = profile_of(section(), 50.0)
    assert (whole.distance.item(), whole.height.item()) == (2.5, -4.5)


def test_the_picture_and_tables_are_reproducible(tmp_path: Path) -> None:
    cut = section(HERE)
    world = Coordinates(HERE, Projection.of(HERE))
    titles = Titles("Section", "of a made-up map", "height")
    paths = write_section(tmp_path / "cut.png", cut, profile_of(cut, 2.0), titles, world)
    assert [path.name for path in paths] == ["cut.png", "cut.csv", "cut_profile.csv"]
    assert set(files_in(tmp_path)) == {"cut.png", "cut.csv", "cut_profile.csv"}
    row = table_of(paths[1])[1]
    place = [f"{number:.4f}" for number in world.of_map(POINTS[2:3, :2])[0]]
    assert list(row.values()) == ["0.5000", "-3.0000", "0.2000", "0.5800", "1.9400", "0", "2", "0.9000", *place]
    assert list(table_of(paths[2])[0])[:8] == list(PROFILE)
    assert table_of(paths[2])[0]["height_m"] == "-4.0000"
    before = files_in(tmp_path)
    write_section(tmp_path / "cut.png", cut, profile_of(cut, 2.0), titles, world)
    assert files_in(tmp_path) == before


@pytest.mark.slow
@pytest.mark.parametrize(("rise", "factor"), [(0.0, 1.0), (0.5, 1.0), (40.0, 1.0), (40.0, 0.5), (2.0, 5.0)])
def test_the_picture_has_one_scale(rise: float, factor: float) -> None:
    points = np.linspace([0.0, 0, -rise], [10, 0, 0], 30)
    cut = section_of(placed(points), points[[0, -1], :2], 1.0, Coordinates())
    titles = Titles("Section", "", "height above mean sea level", factor)
    figure = section_figure(cut, profile_of(cut, 1.0), titles)
    figure.draw_without_rendering()
    axes = figure.axes[0]
    box = axes.get_window_extent()
    (left, right), (low, high) = axes.get_xlim(), axes.get_ylim()
    assert box.height / (high - low) == pytest.approx(factor * box.width / (right - left))
    assert left <= 0 < 10 <= right
    assert low <= -rise <= 0 <= high
    assert axes.get_xlabel() == "distance along the line [m]"
    assert axes.get_ylabel() == "height above mean sea level\n[m]"
