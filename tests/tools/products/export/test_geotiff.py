"""GeoTIFF grids, read by rasterio, against a loop over the points; meshes of the grid."""

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import rasterio
import trimesh
from pyproj import Transformer
from scipy.spatial.transform import RigidTransform, Rotation

from sonarmap.kernels.errors import InputError
from sonarmap.tools.files.geo import Georeference
from sonarmap.tools.files.map_folder.folder import MapPart
from sonarmap.tools.products.export.georeferenced import Georeferenced, MapGrid
from sonarmap.tools.products.export.geotiff import NODATA, write_geotiff
from sonarmap.tools.products.export.grid import empty_share, round_cell, sufficient_cell, top_cells, write_mesh
from tests.tools.products.export.finished import georeferenced, scattered


def written(path: Path, earth: Georeferenced) -> rasterio.DatasetReader:
    write_geotiff(path, earth)
    return rasterio.open(path)


@pytest.mark.parametrize(
    ("place", "epsg"), [((60.0, 11.9995), 32632), ((-70.0, -60.0002), 32720), ((-17.5, 179.9995), 32760)]
)
def test_every_cell_has_the_height_of_its_uppermost_surface(
    place: tuple[float, float], epsg: int, tmp_path: Path
) -> None:
    here = Georeference(*place, height=-2.5, heading=51.0)
    earth = replace(georeferenced(here, scattered(3, reach=15.0), points=900), cell=1.5)
    with written(tmp_path / "grid.tif", earth) as raster:
        assert raster.crs.to_epsg() == epsg
        height, sigma, count = raster.read()
        inverse = ~raster.transform
        # the file's own georeference, and degrees by pyproj alone
        geodetic = earth.points
        east, north = Transformer.from_crs(4326, epsg, always_xy=True).transform(geodetic[:, 1], geodetic[:, 0])
        cells: dict[tuple[int, int], list[int]] = {}
        # pyrefly: ignore[unsupported-operation]
        for k, (column, row) in enumerate(zip(*(inverse @ (np.array(east), np.array(north))), strict=True)):
            cells.setdefault((math.floor(row), math.floor(column)), []).append(k)
    for (row, column), members in cells.items():
        top = max(geodetic[k, 2] for k in members)
        used = [k for k in members if geodetic[k, 2] >= top - earth.folder.voxel]
        assert geodetic[used, 2].min() - 1e-4 < height[row, column] < top + 1e-4
        assert count[row, column] == earth.surface.columns["count"][used].sum()
    empty = np.ones(height.shape, bool)
    empty[tuple(np.array(list(cells)).T)] = False
    assert (np.stack([height, sigma, count])[:, empty] == NODATA).all()


def test_band_2_is_the_sigma_of_the_heights() -> None:
    """Against drawn errors of ranges and of poses that are uncertain horizontally but not in height."""
    rng = np.random.default_rng(2)
    T = RigidTransform.from_components(
        [[5.0, -3, 2], [-8, 4, 1]], Rotation.from_euler("zyx", [[0.4, 0.3, -0.2], [2, 0, 0.5]])
    )
    part = replace(
        georeferenced(Georeference(60.0, 9.1), T, points=30).part,
        covariances=np.tile(np.diag([1e-5, 2e-5, 4e-3, 3.0, 2.5, 0.02]), (2, 1, 1)),
    )
    scan = part.columns["scan"]
    beams = T[scan].inv().apply(part.points)
    errors = rng.multivariate_normal(np.zeros(6), part.covariances[0], (1500, 2))
    along = beams / np.linalg.norm(beams, axis=1)[:, None]
    drawn = np.stack([
        T[scan].rotation.apply(np.cross(each[scan, :3], beams) + each[scan, 3:] + rng.normal(0, 0.3, (30, 1)) * along)
        for each in errors
    ])  # fmt: skip
    of_all = np.sqrt((drawn**2).mean(axis=(0, 2)))
    known = replace(part, columns={**part.columns, "sigma": of_all.astype(np.float32)})
    np.testing.assert_allclose(known.height_sigma, drawn[:, :, 2].std(axis=0), rtol=0.15)
    assert (known.height_sigma < 0.8 * of_all).all()


def test_stray_echoes_are_left_out_of_the_grid(tmp_path: Path) -> None:
    """Strays are above and below a bed, some of them in clumps."""
    rng = np.random.default_rng(4)
    flat = np.stack(np.meshgrid(np.arange(40.0), np.arange(40.0)), -1).reshape(-1, 2)
    bed = np.column_stack([flat + rng.uniform(-0.3, 0.3, flat.shape), rng.normal(-10, 0.1, len(flat))])
    strays = np.column_stack([rng.uniform(0, 40, (60, 2)), np.repeat([5.0, -30.0], 30)])
    strays[::6] = strays[1::6] + 0.7
    earth = georeferenced(Georeference(60.0, 9.1), scattered(2), points=len(bed) + len(strays))
    part = replace(earth.part, points=np.concatenate([bed, strays]))
    earth = replace(earth, part=part, folder=replace(earth.folder, voxel=1.0), cell=1.0)
    with written(tmp_path / "grid.tif", earth) as raster:
        height = raster.read(1, masked=True)
    assert -11 < height.min() < height.max() < -9
    # pyrefly: ignore[missing-attribute]
    assert height.count() > 0.7 * len(bed)
    assert len(earth.part.points) == len(bed) + len(strays)  # the map's own points stay


def test_walls_and_overhangs_have_the_height_of_their_top() -> None:
    heights = np.array([-20.0, -19.9, -12.0, -5.0, -5.1, -5.3])  # a bed, a wall, and an overhang above both
    zeros, ones = np.zeros(6, np.int64), np.ones(6)
    cells = top_cells(zeros, zeros, heights, 0.1 * ones, ones, voxel=0.25)
    assert cells.height.tolist() == pytest.approx([-5.05])
    assert cells.count.tolist() == [2]
    assert cells.sigma[0] == pytest.approx(math.hypot(0.1, 0.05))


def test_a_grid_of_too_many_cells_is_refused(tmp_path: Path) -> None:
    earth = replace(georeferenced(Georeference(60.0, 9.1), scattered()), cell=0.001)
    with pytest.raises(InputError, match="--cell"):
        write_geotiff(tmp_path / "grid.tif", earth)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("strip", [10_000_000, 700])
def test_empty_share_counts_empty_cells_in_the_coverage(strip: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """Points every meter on a disk with a hole 20 m wide, and on an L."""
    monkeypatch.setattr("sonarmap.tools.products.export.grid._STRIP", strip)
    every = np.stack(np.meshgrid(np.arange(60.0), np.arange(60.0)), -1).reshape(-1, 2) + 0.5
    away = np.hypot(*(every - 30).T)
    disk, corner = every[(away < 29) & (away > 10)], every[(every < 9).any(axis=1)]
    for places in (disk, corner - 300):
        assert empty_share(places, 1.0, 2.0) == 0  # closing fills nothing
        assert empty_share(places, 4.0, 2.0) == 0
        for cell, least in ((0.5, 0.7), (0.25, 0.92), (0.02, 0.999)):  # 1 cell of 4, 16 and 2500 is filled
            assert least < empty_share(places, cell, 2.0) < 1 - (cell * 0.99) ** 2
        assert sufficient_cell(places, 0.02, 2.0) == sufficient_cell(places, 0.5, 2.0) == 1.0
        assert sufficient_cell(places, 1.3, 2.0) == 1.3
    thinned = corner[np.random.default_rng(1).random(len(corner)) > 0.1]
    full = {tuple(place) for place in corner.astype(int).tolist()}
    lost = 1 - len(thinned) / len(full)
    assert empty_share(thinned, 1.0, 2.0) == pytest.approx(lost, abs=0.01)
    assert sufficient_cell(thinned, 1.0, 2.0) == 2.0


def test_the_share_of_empty_cells_is_reported(tmp_path: Path) -> None:
    """Voxels of 1 m: half of the cells of 0.5 m and more are empty, none of 2 m."""
    flat = np.stack(np.meshgrid(np.arange(30.0), np.arange(20.0)), -1).reshape(-1, 2) + 0.3
    earth = georeferenced(Georeference(60.0, 9.0), scattered(2), points=600)
    part = replace(earth.part, points=np.column_stack([flat, np.full(600, -9.0)]))
    grid = MapGrid(replace(earth.folder, voxel=1.0), part, cell=0.5)
    details = write_geotiff(tmp_path / "grid.tif", grid)
    assert (details["cell_m"], details["sufficient_cell_m"]) == (0.5, 1.0)
    with rasterio.open(tmp_path / "grid.tif") as raster:
        # pyrefly: ignore[missing-attribute]
        assert details["empty_share"] == pytest.approx(1 - raster.read(1, masked=True).count() / (59 * 39))


def test_a_geotiff_has_its_metadata(tmp_path: Path) -> None:
    earth = georeferenced(Georeference(60.0, 9.1, vertical="MSL"), scattered(3, reach=20.0))
    with written(tmp_path / "grid.tif", earth) as raster:
        assert raster.dtypes == ("float32",) * 3
        assert raster.nodatavals == (NODATA,) * 3
        # pyrefly: ignore[missing-attribute]
        assert raster.compression.name == "deflate"
        assert raster.profile["tiled"]
        assert raster.res == (0.2, 0.2)
        assert raster.transform.e < 0 == raster.transform.b == raster.transform.d  # north up
        edges = np.array([raster.transform.c, raster.transform.f]) / 0.2  # at multiples of a cell's size
        np.testing.assert_allclose(edges, np.rint(edges), rtol=0, atol=1e-6)
        assert raster.descriptions[0] == "height above mean sea level"
        assert raster.units == ("m", "m", "points")
        tags = raster.tags()
    for name, words in (("AREA_OR_POINT", "Area"), ("VERTICAL_REFERENCE", "EPSG:5714"), ("SIGN", "positive up")):
        assert words in tags[name]
    assert {path.name for path in tmp_path.iterdir()} == {"grid.tif", "grid.qml"}


def test_cell_sizes_are_rounded_up() -> None:
    sizes = {0.2: 0.2, 0.21: 0.5, 0.347: 0.5, 0.5: 0.5, 0.84: 1.0, 1.0: 1.0, 1.01: 2.0, 13.0: 20.0}
    assert {voxel: round_cell(voxel) for voxel in sizes} == sizes


def part_of(points: np.ndarray) -> MapPart:
    """Map part of these points, seen from the origin."""
    T = RigidTransform.from_translation(np.zeros((1, 3)))
    part = georeferenced(Georeference(60.0, 5.0), T, len(points)).part
    return replace(part, points=points)


def read(path: Path) -> tuple[np.ndarray, np.ndarray]:
    """Vertices (V, 3) in x, y, z of the map, and triangles."""
    if path.suffix == ".ply":
        mesh: Any = trimesh.load_mesh(path, process=False)
        return np.asarray(mesh.vertices), np.asarray(mesh.faces)
    scene: Any = trimesh.load_scene(path, process=False)
    (mesh,) = scene.dump()  # with the nodes' translations
    x, up, toward = np.asarray(mesh.vertices).T
    return np.column_stack([x, -toward, up]), np.asarray(mesh.faces)


def slope(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    return 0.25 * x - 0.5 * y - 7


@pytest.mark.parametrize(("suffix", "far"), [("ply", 0.0), ("glb", 431_000.0)])
def test_the_mesh_covers_the_grid_and_faces_up(tmp_path: Path, suffix: str, far: float) -> None:
    """A corner cell and one in the middle are missing: the corner's square keeps a triangle, and so do four others."""
    x, y = (axis.ravel() for axis in np.meshgrid(np.arange(7) + 0.5, np.arange(5) + 0.5))
    kept = ~((x == 3.5) & (y == 2.5)) & ~((x == 6.5) & (y == 4.5))
    points = np.column_stack([x, y, slope(x, y)])[kept] + [far, -2 * far, 0]
    path = tmp_path / f"surface.{suffix}"
    details = write_mesh(path, part_of(points), 1.0)
    vertices, triangles = read(path)
    assert (details["vertices"], details["triangles"]) == (len(vertices), len(triangles)) == (33, 2 * 19 + 5)
    order, wanted = np.lexsort(vertices.T[:2]), np.lexsort(points.T[:2])
    np.testing.assert_allclose(vertices[order], points[wanted], rtol=0, atol=1e-3)
    a, b, c = (vertices[triangles[:, k]] for k in range(3))
    normals = np.cross(b - a, c - a)
    assert (normals[:, 2] > 0).all()
    assert normals[:, 2].sum() / 2 == pytest.approx(19 + 5 / 2, abs=0.05)  # the squares' area from above


def test_a_mesh_of_isolated_points_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="--cell M"):
        write_mesh(tmp_path / "surface.ply", part_of(np.array([[0.0, 0, 0], [9.0, 0, 0], [0, 9.0, 0]])), 1.0)
