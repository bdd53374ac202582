"""Optional layers of the page in Chromium, and the packing of points."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial import KDTree

from sonarmap.tools.files.map_folder.folder import Map
from sonarmap.tools.files.map_folder.names import FULL_GRAPH
from sonarmap.tools.files.user_file import read_json
from sonarmap.tools.products.report.content import content_of
from sonarmap.tools.products.report.points import FRACTION, codes, pack
from tests.tools.products.report.browser import Opened, opened
from tests.tools.products.report.known_map import folder_of, known_points, unpack, written

SHIFT = np.array([0.75, -1.5, 0.25])  # of the track before the loops [m]


def with_track_before_loops(out: Path) -> Map:
    """Map of the known points whose track before the loops is off by SHIFT."""
    folder = folder_of(known_points(), out)
    graph = read_json(out / FULL_GRAPH, "a graph")
    for pose in graph["poses"]:
        before = np.array(pose["T_world_sensor"])
        before[:3, 3] += SHIFT
        pose["T_world_sensor_before_loops"] = before.tolist()
    return replace(folder, graph=graph)


@pytest.fixture(scope="module")
def shown(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Opened]:
    out = tmp_path_factory.mktemp("layers") / "out"
    with opened(written(content_of(with_track_before_loops(out)), out / "report.html")) as page:
        yield page


VOXEL = 0.25
FINE = VOXEL / FRACTION


def surface(count: int, seed: int = 4) -> np.ndarray:
    """One random point in each voxel of a wavy bed, far from the origin."""
    rng = np.random.default_rng(seed)
    side = int(np.sqrt(count))
    x, y = (axis.ravel() for axis in np.meshgrid(np.arange(side), np.arange(side), indexing="ij"))
    z = np.floor(20 * np.sin(x / 40) + 12 * np.cos(y / 25))
    return np.array([480_000.0, -1_200.0, -35.0]) + VOXEL * (np.column_stack([x, y, z]) + rng.random((side * side, 3)))


def test_points_are_unpacked_within_half_a_quantum_with_their_columns() -> None:
    points = surface(20_000)
    rng = np.random.default_rng(1)
    columns = {"seen": rng.integers(0, 256, len(points)), "scan": rng.integers(0, 70_000, len(points))}
    data, layout = pack(points, columns, VOXEL)
    back, same = unpack(data, layout)
    off, which = KDTree(points).query(back)
    np.testing.assert_array_equal(np.sort(which), np.arange(len(points)))
    assert np.abs(back - points[which]).max() <= FINE / 2 + 1e-9
    assert off.max() > FINE / 4  # quantization does change the points
    assert layout["planes"] == {"seen": 1, "scan": 3}
    for name, values in columns.items():
        np.testing.assert_array_equal(same[name], values[which])


def test_codes_are_logarithmic() -> None:
    """From 2 to 32 the geometric mean 8 is in the middle; values that are not positive and finite have code 0."""
    values, (low, high) = codes(np.array([2.0, 8.0, 32.0, 0.0, np.nan, -1.0, np.inf]))
    assert values.tolist() == [1, 128, 255, 0, 0, 0, 0]
    assert (low, high) == (2.0, 32.0)
    assert codes(np.array([np.nan]))[0].tolist() == [0]
    assert codes(np.array([5.0, 5.0]))[0].tolist() == [1, 1]


def test_packing_a_surface_is_compact_and_reproducible() -> None:
    """About three bytes a point: six bits an axis within the voxel, and little for the voxel itself."""
    points = surface(60_000)
    data, layout = pack(points, {}, VOXEL)
    assert len(data) / len(points) < 3.3
    assert (data, layout) == pack(points.copy(), {}, VOXEL)


def test_the_track_before_the_loops_is_shown_on_request(shown: Opened) -> None:
    page = shown.page
    count = "sonarmap.view.scene.lines.get('before').count"
    assert page.evaluate(count) == 0
    page.locator("label.before input").check()
    assert page.evaluate(count) == page.evaluate("sonarmap.view.scene.lines.get('track').count")
    track = page.evaluate("sonarmap.view.part.track")
    np.testing.assert_allclose(np.subtract(track["before"], track["places"]), np.tile(SHIFT, (8, 1)), atol=2e-5)
