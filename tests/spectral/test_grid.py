"""The grid that scans share: checks, choice and centers; and checks of scans."""

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform

from sonarmap.kernels.device.device import choose_device
from sonarmap.kernels.errors import InputError
from sonarmap.kernels.fft.edges import EDGES
from sonarmap.spectral.grid import Grid, choose_grid, coarse_edge, image_edge, scan_center
from sonarmap.spectral.hemisphere import HemisphereRegistrar
from sonarmap.spectral.registration import SpectralConfig, SpectralRegistrar
from sonarmap.spectral.scan import Scan
from tests.samples.scenes.reliefs import HERE, T_TRUE, THERE, relief, seen
from tests.samples.scenes.structures import TURN, assert_near, moved, registered, structure


def box_scan(low: list[float], high: list[float]) -> Scan:
    return Scan(np.random.default_rng(3).uniform(low, high, (5000, 3)).astype(np.float32))


@pytest.mark.parametrize(
    ("edge", "near"),
    [(98, (96, 100)), (75, (72, 80)), (8, (16, 18)), (1000, (500, 512))],
)
def test_refuses_an_edge_that_is_no_even_product_and_suggests_near_ones(edge: int, near: tuple[int, int]) -> None:
    words = (
        f"`edge={edge}` is not an even product of 2, 3 and 5 from 16 to 512; try `edge={near[0]}` or `edge={near[1]}`"
    )
    with pytest.raises(InputError, match=words):
        Grid(edge, 1.0)


NO_EDGE = "is not an even product of 2, 3 and 5 from 16 to 512; try `edge=64` or"
NO_VOXELS: list[Any] = [-1.0, float("nan"), None, np.ones(2)]


@pytest.mark.parametrize(
    ("make", "given", "words"),
    [
        *((partial(Grid, voxel=1.0), edge, NO_EDGE) for edge in (None, 64.0, np.array([64, 64]))),
        *((choose_grid, scans, "wanted a list of Scan") for scans in (None, [np.zeros((5, 3))])),
        *((partial(Grid, 64), voxel, r"`voxel=0\.5`") for voxel in NO_VOXELS),
    ],
)
def test_refuses_invalid_edges_scans_and_voxels(make: Callable[[Any], object], given: Any, words: str) -> None:
    with pytest.raises(InputError, match=words):
        make(given)


def test_stray_echoes_do_not_move_the_center() -> None:
    scan = box_scan([10, -4, 2], [30, 6, 5])
    stray = Scan(np.vstack([scan.points, np.array([[900, 900, -900]], np.float32)]))
    np.testing.assert_allclose(scan_center(scan), [20, 1, 3.5], atol=0.2)
    np.testing.assert_allclose(scan_center(stray), scan_center(scan), atol=0.05)


def test_chosen_grid_holds_the_largest_scan_with_a_margin() -> None:
    scans = [box_scan([0, 0, 0], [3, 2, 1]), box_scan([5, 5, 5], [25, 10, 8])]
    grid = choose_grid(scans, 64)
    assert grid.edge == 64
    assert 20 * 1.1 < grid.extent < 20 * 1.25
    for scan in scans:
        voxels = grid.to_voxels(scan.points, scan_center(scan))
        assert (np.abs(voxels) < 32).all()


def test_a_given_voxel_is_kept_and_a_scan_without_extent_is_refused() -> None:
    assert choose_grid([box_scan([0, 0, 0], [3, 2, 1])], 32, 0.7) == Grid(32, 0.7)
    with pytest.raises(InputError, match="one place"):
        choose_grid([Scan(np.ones((9, 3), np.float32))])


class TestRegistrations:
    """Registration on grids of various edges, also some whose half is odd."""

    @pytest.mark.parametrize("edge", [30, 50, 90, 162, 250])
    @pytest.mark.slow
    def test_at_every_edge(self, edge: int) -> None:
        """Two scans of odd numbers of points, and one with itself, which correlates alike at many shifts: within
        a fifth of a voxel and a bin of the rotations; on the coarsest grids they are not sure."""
        level = SpectralConfig(max_tilt=float(np.deg2rad(12.0)))  # whose tables take a third of the time
        registrar = SpectralRegistrar(choose_device(), Grid(edge, 32.0 / edge), level)
        points = [seen(relief(1, 20_000), pose) for pose in (HERE, THERE)]
        target, source = (registrar.prepare(Scan(each[: len(each) - 1 + len(each) % 2])) for each in points)
        registration, again = registrar.register(target, source), registrar.register(target, target)
        assert again.accepted
        assert registration.accepted or edge < 30, registration.reason
        for found, truth in ((registration, T_TRUE), (again, RigidTransform.identity())):
            assert_near(found.T_target_source, truth, max(45 / edge, 0.3), max(6.4 / edge, 0.03))

    @pytest.mark.parametrize("edge", [36, 90])
    @pytest.mark.slow
    def test_over_the_hemisphere(self, edge: int) -> None:
        """Within a bin of the images and a voxel."""
        registrar = HemisphereRegistrar(choose_device(), Grid(edge, 25.6 / edge))
        registration = registered(registrar, structure(1), moved(structure(1), TURN.inv()))
        assert registration.accepted, registration.reason
        assert_near(registration.T_target_source, TURN, 180 / edge, 25.6 / edge)


POINTS = np.arange(12, dtype=np.float32).reshape(4, 3)


ROWS = {"viewpoints": POINTS, "times": POINTS[:, 0], "strength": POINTS[:, 0]}


@pytest.mark.parametrize(
    ("name", "given", "message"),
    [
        *(
            (name, array[:3], r"is float32 of shape \(3\b.*; wanted float32 of shape \(4,")
            for name, array in ROWS.items()
        ),
        *((name, array.astype(np.float64), "is float64") for name, array in ROWS.items()),
        *((name, np.where(array > 6, np.nan, array), "[12] of 4 rows of") for name, array in ROWS.items()),
        ("strength", -ROWS["strength"], "3 of 4 rows of `strength` are negative, NaN or infinite"),
    ],
)
def test_unusable_rows_of_points_are_refused(name: str, given: np.ndarray, message: str) -> None:
    with pytest.raises(InputError, match=f"pier: .*{message}.*"):
        Scan(POINTS, **{"name": "pier", name: given})


@pytest.mark.parametrize("given", [{"points": None}, {"strength": [1.0] * 4}])
def test_points_that_are_no_array_are_refused(given: dict[str, Any]) -> None:
    name, value = next(iter(given.items()))
    with pytest.raises(InputError, match=f"pier: `{name}` are {type(value).__name__}; wanted an array of float32"):
        Scan(**{"points": POINTS, "name": "pier", **given})
    with pytest.raises(InputError, match="scan: `viewpoints` are list; wanted an array of float32"):
        Scan(**{"points": POINTS, "viewpoints": POINTS.tolist()})


def test_every_edge_has_a_coarse_grid_and_images() -> None:
    """Half of 90 is odd and half of 30 too small, so the nearest allowed one is taken. From 128 on it is 64."""
    for edge in EDGES:
        assert Grid(edge, 1.0).edge == edge
        assert coarse_edge(edge) in EDGES
        assert edge < 32 or edge > 128 or 0.44 < coarse_edge(edge) / edge < 0.56
        assert edge < 128 or coarse_edge(edge) == 64
        assert edge <= image_edge(edge) <= max(32, 4 / 3 * edge)
        assert image_edge(edge) % 16 == 0
        assert image_edge(edge) in EDGES
    assert [coarse_edge(edge) for edge in (16, 64, 90, 96, 128, 160, 250, 512)] == [16, 32, 48, 48, 64, 64, 64, 64]
    assert [image_edge(edge) for edge in (16, 90, 128, 450)] == [16, 96, 128, 480]


def test_voxels_are_relative_to_the_center_in_meters_over_voxel() -> None:
    points = np.array([[10.0, -2.0, 7.0]], np.float32)
    np.testing.assert_allclose(Grid(16, 0.5).to_voxels(points, np.array([9.0, -1.0, 4.0])), [[2, -2, 6]])
