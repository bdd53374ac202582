"""`sonarmap compare` of a map and a point cloud of another program: end to end, and what is refused."""

from pathlib import Path

import laspy
import numpy as np
import pytest
import rasterio
from scipy.spatial.transform import Rotation

import sonarmap as library
from sonarmap.tools.files.geo import Georeference
from sonarmap.tools.files.map_folder.folder import read_map_folder
from sonarmap.tools.files.writers.points import write_ply
from tests.samples.clutter_scans import done, printed, refused, said, sonarmap
from tests.tools.products.export.finished import finished_map


@pytest.fixture(scope="module")
def placed(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """A map on the Earth, and its points as LAZ."""
    root = tmp_path_factory.mktemp("placed")
    folder = finished_map(root / "map", georeference=Georeference(60.0, 9.0, height=-3.0))
    done(sonarmap("export", folder, "-o", root / "out", "--format", "laz"))
    return folder, root / "out" / "map.laz"


def test_a_cloud_and_a_map_on_the_earth_are_compared(placed: tuple[Path, Path], tmp_path: Path) -> None:
    folder, cloud = placed
    result = done(sonarmap("compare", cloud, folder, "-o", tmp_path, "--same-frame"))
    said(result, "errors of the poses of", "are taken to count from 'surface'")
    assert "0 regions changed" in result.stdout
    theirs = laspy.read(cloud)
    with rasterio.open(tmp_path / "changes.tif") as raster:
        corners = np.reshape(raster.bounds, (2, 2))
    np.testing.assert_allclose(corners, [theirs.xyz.min(axis=0)[:2], theirs.xyz.max(axis=0)[:2]], rtol=0, atol=2)
    back = printed(sonarmap("compare", folder, cloud, "-o", tmp_path, "--same-frame", "--json"))
    assert (back["new"], back["regions"], len(back["notes"])) == (str(cloud), [], 3)


@pytest.mark.slow
def test_a_map_and_its_own_points_in_another_frame_have_not_changed(tmp_path: Path) -> None:
    done(sonarmap("simulate", "--scene", "harbor", "--scans", "12", "--seed", "4", "-q", "-o", tmp_path / "scans"))
    options = ("--grid", "64", "--loops", "0", "--no-report")
    done(sonarmap("map", tmp_path / "scans", "-o", tmp_path / "map", *options))
    points = read_map_folder(tmp_path / "map").parts[0].points.astype(np.float64)
    for turn in (0.0, 40.0):
        moved = Rotation.from_euler("z", turn, degrees=True).apply(points) + np.full(3, 1000.0)
        write_ply(tmp_path / "moved.ply", moved)
        found = printed(sonarmap("compare", tmp_path / "map", tmp_path / "moved.ply", "-o", tmp_path / "out", "--json"))
        assert found["regions"] == []


def test_invalid_arguments_are_refused(placed: tuple[Path, Path], tmp_path: Path) -> None:
    folder, cloud = placed
    out = ("-o", tmp_path / "out")
    points = read_map_folder(folder).parts[0].points
    write_ply(tmp_path / "mm.ply", points * 1000)
    (tmp_path / "notes.doc").write_bytes(b"x")
    for given, words in (
        ((cloud, cloud), "both are point clouds"),
        ((folder, tmp_path / "mm.ply"), "m; wanted meters"),
        ((folder, tmp_path / "missing.ply"), "cannot read"),
        ((folder, tmp_path / "notes.doc"), "nor a file of points"),
        ((folder, "--surveys", "--cloud-sigma", "0.1"), "--cloud-sigma has no effect with --surveys"),
        ((folder, cloud, "--cloud-sigma", "0"), "above 0"),
        ((cloud, folder, "--origin", "60,9"), "lies where its CRS says"),
    ):
        refused(sonarmap("compare", *given, *out), words)
    with pytest.raises(library.InputError, match="`old=5` cannot be used"):
        library.compare(5, folder)
    with pytest.raises(library.InputError, match="`cloud_sigma` has no effect without"):
        library.compare(folder, folder, cloud_sigma=0.1)
