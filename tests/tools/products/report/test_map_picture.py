"""The picture of a map: labels, extent, colors, and reproducible bytes."""

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from matplotlib.figure import Figure

from sonarmap.slam.survey_result import SurveyResult
from sonarmap.tools.files.geo import Georeference
from sonarmap.tools.products.report.pictures import draw_map, map_figure
from tests.tools.products.export.finished import mapped as ring

HERE = Georeference(60.3913, -5.3221, 3.5, "MSL")
INPUTS = ["/somewhere/harbor"]
MEASURED = ("tilt_x", "tilt_y", "heading", "east", "north", "up")


@pytest.fixture
def mapped() -> SurveyResult:
    return ring(split=True)


def measured(result: SurveyResult, *unmeasured: str, part: int = 0) -> SurveyResult:
    """The result as if instruments had measured a part in all directions but the `unmeasured`."""
    members = result.components[part]
    free = np.array([name in unmeasured for name in MEASURED])
    gauge = SimpleNamespace(unmeasured={members[0]: free} if unmeasured else {})
    graph: Any = SimpleNamespace(priors=[(members[1], None)], known=[], gauge=gauge)
    solution: Any = SimpleNamespace(graph=graph)
    return replace(result, solution=solution)


def labels(figure: Figure) -> tuple[str, str, str]:
    """Labels of the x axis, of the color bar, and of the origin."""
    axes, bar = figure.axes
    return axes.get_xlabel(), bar.get_ylabel(), figure.get_supxlabel()


def with_points(result: SurveyResult, points: np.ndarray) -> SurveyResult:
    """The result with these points in its first map."""
    n = len(points)
    columns: dict[str, Any] = {name: np.ones(n, np.int32) for name in ("scan", "seen", "count", "survey")}
    point_map = replace(result.maps[0], points=points, sigma=np.ones(n, np.float32), strength=None, looked=None)
    first = replace(result.parts[0], optimized=replace(point_map, **columns))
    return replace(result, parts=(first, *result.parts[1:]))


@pytest.mark.parametrize(
    ("missing", "here", "across", "levels", "origin"),
    [
        (None, None, "x [m]", "height relative to the first scan [m]", ""),
        ((), HERE, "East [m]", "depth below mean sea level [m]", "60.3913000, -5.3221000 (WGS84)."),
        (None, replace(HERE, heading=40.0), "x [m]", "depth below mean sea level [m]", "and x points to 40°"),
    ],
)
def test_labels_name_the_axis_the_depth_reference_and_the_origin(
    mapped: SurveyResult,
    missing: tuple[str, ...] | None,
    here: Georeference | None,
    across: str,
    levels: str,
    origin: str,
) -> None:
    result = mapped if missing is None else measured(mapped, *missing)
    first = labels(map_figure(result, 1, INPUTS, here))
    assert (first[:2], origin in first[2]) == ((across, levels), True)
    assert bool(first[2]) == (here is not None)
    second = labels(map_figure(result, 2, INPUTS, here))
    assert second == ("x [m]", "height relative to the first scan [m]", "")  # the second part is not placed


def test_the_image_covers_its_points_and_deep_is_dark(mapped: SurveyResult) -> None:
    """A slope from z = -30 to -10 along x, a pillar at (20, 5), and a stray."""
    x, y = (axis.ravel() for axis in np.meshgrid(np.arange(0, 30, 0.5), np.arange(0, 15, 0.5)))
    pillar, stray = [[20.0, 5.0, -4.0]], [[400.0, 300.0, -20.0]]
    points = np.concatenate([np.column_stack([x, y, -30 + 2 * x / 3]), pillar, stray])
    here = replace(HERE, height=2.0)
    figure = map_figure(with_points(measured(mapped), points), 1, INPUTS, here)
    axes, bar = figure.axes
    assert axes.get_xlim()[1] < 40
    image: Any = axes.images[0]
    left, right, lower, upper = image.get_extent()
    depths = np.ma.masked_invalid(image.get_array())
    rows, columns = np.nonzero(depths == depths.min())
    shares = (np.column_stack([columns, rows]) + 0.5) / depths.shape[::-1]
    places = [left, lower] + shares * [right - left, upper - lower]
    assert depths.min() == pytest.approx(2.0)  # z = -4 m from an origin at a height of 2 m
    assert places.mean(axis=0) == pytest.approx([20, 5], abs=0.5)
    lightness = [image.cmap(image.norm(depth))[:3] @ np.array([0.3, 0.6, 0.1]) for depth in (26, 18, 10)]
    assert lightness[0] < lightness[1] - 0.1 < lightness[2] - 0.2
    assert bar.get_ylim()[0] > bar.get_ylim()[1]  # depths grow downward


def test_the_picture_is_reproducible_with_names_in_any_script(mapped: SurveyResult, tmp_path: Path) -> None:
    for name in ("a.png", "b.png"):
        draw_map(tmp_path / name, mapped, 1, ["深 \\$x^ \n\udcff"])
    assert (tmp_path / "a.png").read_bytes() == (tmp_path / "b.png").read_bytes()
    assert (tmp_path / "a.png").stat().st_size > 10_000
