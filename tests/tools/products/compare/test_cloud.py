"""Comparison of a map with a point cloud of another program: known changes, coordinate frames, refused files."""

from pathlib import Path

import numpy as np
import pytest
from pyproj import CRS
from scipy.spatial.transform import RigidTransform

from sonarmap.kernels.errors import InputError
from sonarmap.slam.graph.tangent import lengths
from sonarmap.tools.files.geo import Georeference
from sonarmap.tools.files.map_folder.folder import Map
from sonarmap.tools.products.compare.cloud import PointCloud
from sonarmap.tools.products.compare.comparison import Alignment
from sonarmap.tools.products.compare.detection import Distances, Verdict, regions_of
from sonarmap.tools.products.compare.surface import Epoch
from tests.samples.cloud_files import las, put
from tests.samples.surveys import drawn
from tests.tools.products.compare.made_up import VOXEL, compared, surveyed
from tests.tools.products.export.finished import finished_map

HERE = Georeference(60.0, 9.0, height=-3.0, vertical="MSL")


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Map:
    return Map.open(finished_map(tmp_path_factory.mktemp("cloud") / "map", georeference=HERE))


def as_cloud(epoch: Epoch, beside: Epoch, sigma: float | None = None) -> Epoch:
    return Epoch.of_cloud(epoch.points, epoch.weight, sigma, beside)


@pytest.mark.parametrize(("change", "cloud_is_old"), [(0.4, True), (-0.4, False)])
def test_a_known_change_is_one_region_with_its_volume(change: float, cloud_is_old: bool) -> None:
    old, new = surveyed(5), surveyed(6, change=change)
    distances = compared(as_cloud(old, new), new) if cloud_is_old else compared(old, as_cloud(new, old))
    (region,) = regions_of(distances)
    assert region.gained == (change > 0)
    assert abs(region.volume - 36 * change) < 3 * region.sigma
    assert (distances.cores.normals[:, 2] > 0.9).all()  # also the cloud's: toward the map's sensor positions


def test_a_larger_sigma_raises_the_level_of_detection() -> None:
    old, new = surveyed(3), surveyed(4)
    levels = [np.nanmedian(compared(old, as_cloud(new, old, sigma)).level) for sigma in (None, 1.0)]
    assert levels[1] > 1.5 * levels[0]


@pytest.mark.parametrize(("tilt", "verdict"), [(0.0, Verdict.LOST), (np.pi / 2, Verdict.UNSURE)])
def test_a_loss_in_a_wall_is_unsure_against_a_cloud(tilt: float, verdict: Verdict) -> None:
    """The same change in a bed and, turned, in a wall, of which a cloud may show the other side."""
    T = RigidTransform.from_exp_coords([0, tilt, 0, 0, 0, 0])
    old, new = surveyed(5).moved(T), surveyed(6, change=-2 * VOXEL).moved(T)
    assert (_within(compared(old, new)) == Verdict.LOST).mean() > 0.9
    assert (_within(compared(old, as_cloud(new, old))) == verdict).mean() > 0.9


def _within(distances: Distances) -> np.ndarray:
    """Verdicts of the core points within 2 m of the center."""
    return distances.verdict[np.linalg.norm(distances.cores.points, axis=1) < 2]


def test_the_inverse_alignment_has_the_inverse_transform_and_covariance() -> None:
    T = RigidTransform.from_exp_coords([0.1, -0.05, 1.2, 8.0, -3.0, 1.0])
    C = np.diag([1, 2, 3, 40, 50, 60]) * 1e-6
    given = Alignment(T, C, 5, 4, 6)
    np.testing.assert_allclose((given.inverse.T_old_new * T).as_matrix(), np.eye(4), atol=1e-12)
    np.testing.assert_allclose(given.inverse.inverse.covariance, C, atol=1e-12)
    truths = drawn(np.random.default_rng(1), C, 2000) * T
    xi = (truths.inv() * given.inverse.T_old_new.inv()).as_exp_coords()
    off = lengths(xi, np.tile(given.inverse.covariance, (len(xi), 1, 1)))
    assert np.sqrt((off**2).mean() / 6) == pytest.approx(1, abs=0.03)


def test_a_thinned_cloud_has_a_sigma_of_one_voxel(folder: Map) -> None:
    points = folder.parts[0].points
    thinned = PointCloud.of_points(points, folder)
    assert thinned.sigma == folder.voxel
    assert "seems to be thinned (1.0 points" in thinned.notes[-1]
    assert PointCloud.of_points(points, folder, 0.1).sigma == 0.1
    assert PointCloud.of_points(np.repeat(points, 3, axis=0), folder).sigma is None


def test_unusable_files_are_refused(folder: Map, tmp_path: Path) -> None:
    some = np.random.default_rng(0).uniform(0, 20, (90, 3))
    table = np.column_stack([some, np.ones(len(some))])
    path = put(tmp_path / "cloud.las", las(table, compressed=False))
    assert PointCloud.read(path, folder).georeference is None
    for epsg, words in (
        (4326, "wanted a projected CRS"),
        (2263, r"\(ftUS\); wanted a projected CRS in meters"),
    ):
        put(path, las(table, compressed=False, crs=CRS.from_epsg(epsg)))
        with pytest.raises(InputError, match=words):
            PointCloud.read(path, folder)


def test_large_coordinates_get_a_local_origin(folder: Map) -> None:
    points, far = folder.parts[0].points, np.array([450_123.0, 6_651_234.0, 0])
    cloud = PointCloud.of_points(points + far, folder)
    assert "its coordinates are counted from 450000, 6651000, 0 m" in cloud.notes[1]
    assert np.abs(cloud.points).max() < 1000
    assert cloud.weight.sum() == len(points)
