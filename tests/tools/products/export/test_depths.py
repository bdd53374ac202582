"""Grids of depths: BAG read by GDAL, as it is and as plain HDF5, and CSV, against a sloping bed."""

import csv
import re
from dataclasses import replace
from pathlib import Path
from unittest.mock import patch
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

import numpy as np
import pytest
import rasterio
from pyproj import CRS
from scipy.spatial.transform import RigidTransform

from sonarmap.kernels.errors import InputError
from sonarmap.tools.files.geo import Georeference, Projection
from sonarmap.tools.products.export.depths import UNKNOWN, write_bag, write_depths
from sonarmap.tools.products.export.georeferenced import Georeferenced
from sonarmap.tools.products.export.geotiff import write_geotiff
from tests.samples.places import DATA
from tests.tools.products.export.finished import georeferenced, local_of

HERE = Georeference(60.0, 9.0, height=-2.5, vertical="MSL")  # on the central meridian: grid North is true North
SIGMAS = 0.05, 0.2  # of the scans in the west and in the east [m]
REAL = DATA / "real" / "grids"


def bed_height(local: np.ndarray) -> np.ndarray:
    """Height (N,) above the origin [m] of a bed that falls to the east by 1:50 and rises to the north by 1:200."""
    return -20 - local[:, 0] / 50 + local[:, 1] / 200


def sloping(here: Georeference = HERE) -> Georeferenced:
    """A bed 61 m wide and 24 m long with a hole in the northeast, in cells of 1 m; the scan in the east is less certain
    in height. The sensors are level, and only their heights are uncertain."""
    x, y = (axis.ravel() for axis in np.meshgrid(np.arange(-20, 41, 0.25), np.arange(-9, 15, 0.25)))
    kept = (x < 30) | (y < 8)
    flat = np.column_stack([x, y])[kept]
    east = (flat[:, 0] > 10).astype(np.int32)
    earth = georeferenced(here, RigidTransform.from_translation([[-5.0, 0, 0], [25, 0, 0]]), points=len(flat))
    covariances = np.zeros((2, 6, 6))
    covariances[:, 5, 5] = np.square(SIGMAS)
    columns = {**earth.part.columns, "scan": east, "sigma": np.array(SIGMAS)[east] / np.sqrt(3)}
    points = np.column_stack([flat, bed_height(flat)])
    part = replace(earth.part, points=points, columns=columns, covariances=covariances)
    return replace(earth, part=part, folder=replace(earth.folder, parts=(part,), voxel=0.5), cell=1.0)


def written(path: Path, earth: Georeferenced) -> rasterio.DatasetReader:
    write_bag(path, earth)
    return rasterio.open(path)


def test_gdal_reads_the_elevations_and_uncertainties_of_a_bag(tmp_path: Path) -> None:
    earth = sloping()
    with written(tmp_path / "grid.bag", earth) as bag:
        assert bag.driver == "BAG"
        assert bag.descriptions == ("elevation", "uncertainty")
        assert bag.nodatavals == (UNKNOWN, UNKNOWN)
        elevation, uncertainty = bag.read(masked=True)
        transform = bag.transform
    assert elevation.shape == (24, 61)
    row, column = np.nonzero(~elevation.mask)
    east, north = rasterio.transform.xy(transform, row, column)
    local = local_of(np.column_stack([east, north, np.zeros(len(east))]), 32632, HERE)
    inner = (np.abs(local[:, :2] - [10, 3]) < [29, 11]).all(axis=1)  # at the rim a cell's points are beside its middle
    np.testing.assert_allclose(elevation.compressed()[inner], bed_height(local[inner]) - 2.5, rtol=0, atol=0.01)
    sigma = np.where(local[:, 0] > 10, *SIGMAS[::-1])
    clear = np.abs(local[:, 0] - 10) > 1
    np.testing.assert_allclose(uncertainty.compressed()[clear], sigma[clear], rtol=0, atol=0.01)
    empty = elevation.mask
    assert empty[:6, -9:].all()  # the hole in the northeast
    assert not empty[:6, :9].any()
    assert (empty == uncertainty.mask).all()


def test_bag_csv_and_geotiff_have_the_numbers_of_the_grid(tmp_path: Path) -> None:
    earth = sloping()
    grid = earth.depth_grid
    for write, name in ((write_bag, "grid.bag"), (write_geotiff, "grid.tif"), (write_depths, "depths.csv")):
        write(tmp_path / name, earth)
    with rasterio.open(tmp_path / "grid.bag") as bag, rasterio.open(tmp_path / "grid.tif") as tif:
        assert bag.transform == tif.transform
        at = rasterio.transform.rowcol(bag.transform, grid.east, grid.north)
        np.testing.assert_array_equal(bag.read()[:, *at], tif.read((1, 2))[:, *at])
        np.testing.assert_allclose(bag.read(1)[at], -grid.depth, rtol=0, atol=1e-5)
        np.testing.assert_allclose(bag.read(2)[at], grid.cells.sigma, rtol=0, atol=1e-7)
        np.testing.assert_array_equal(tif.read(3)[at], grid.cells.count)
        assert (bag.read(1) != UNKNOWN).sum() == len(grid.depth)
        assert tif.descriptions[1] == "vertical uncertainty, one standard deviation"
    with (tmp_path / "depths.csv").open(newline="") as file:
        head, *rows = csv.reader(file)
    assert head == ["easting_m", "northing_m", "depth_m", "depth_sigma_m", "soundings"]
    expected = np.column_stack([grid.east, grid.north, grid.depth, grid.cells.sigma, grid.cells.count])
    np.testing.assert_allclose(np.array(rows, float), expected, rtol=0, atol=5.1e-4)
    table = np.array(rows, float)
    assert (table[:, 2] > 20).all()  # positive down
    assert 499_000 < table[:, 0].min() < table[:, 0].max() < 501_000  # easting first
    assert (np.diff(table[:, 1]) <= 0).all()  # from the north


@pytest.mark.filterwarnings("ignore:Dataset has no geotransform")
def test_as_hdf5_the_first_node_of_a_bag_is_in_the_southwest(tmp_path: Path) -> None:
    with written(tmp_path / "grid.bag", sloping()) as bag:
        elevation, uncertainty = bag.read()
    for name, values in (("elevation", elevation), ("uncertainty", uncertainty)):
        with rasterio.open(f'HDF5:"{tmp_path / "grid.bag"}"://BAG_root/{name}') as raw:
            np.testing.assert_array_equal(raw.read(1), values[::-1])
    assert elevation[0, 0] > elevation[-1, 0]  # the bed rises to the north


@pytest.mark.parametrize(
    ("vertical", "crs", "name"),
    [
        ("MSL", None, "MSL height"),
        ("EGM2008", "EPSG:25832", "EGM2008 height"),
        ("surface", None, "unknown"),
        ("ellipsoid", "EPSG:25832", "Ellipsoidal height"),
    ],
)
def test_gdal_reads_the_crs_and_the_vertical_datum(vertical: str, crs: str | None, name: str, tmp_path: Path) -> None:
    here = replace(HERE, vertical=vertical)
    earth = replace(sloping(here), projection=Projection.of(here, crs))
    with written(tmp_path / "grid.bag", earth) as bag:
        assert bag.crs is not None
        read = CRS.from_wkt(bag.crs.to_wkt())
        metadata = bag.tags(ns="xml:BAG")["xml:BAG"]
    horizontal = read.sub_crs_list[0] if read.sub_crs_list else read.to_2d()
    assert horizontal.equals(earth.projection.crs, ignore_axis_order=True)
    up = read.axis_info[2]
    assert (up.direction, up.unit_name) == ("up", "metre")
    assert name == (read.sub_crs_list[1].name if read.sub_crs_list else up.name)
    assert ('VERT_DATUM["unknown"' in metadata) == (vertical == "surface")


def metadata_of(path: Path) -> Element:
    with rasterio.open(path) as bag:
        return ElementTree.fromstring(bag.tags(ns="xml:BAG")["xml:BAG"])


def test_the_metadata_names_the_uncertainty_and_the_nodes(tmp_path: Path) -> None:
    earth = sloping()
    earth = replace(earth, folder=replace(earth.folder, path=Path("a <b> & c")))
    with written(tmp_path / "grid.bag", earth) as bag:
        corners = *bag.xy(bag.height - 1, 0), *bag.xy(0, bag.width - 1)
    root = metadata_of(tmp_path / "grid.bag")
    code = root.find(".//{*}BAG_VertUncertCode")
    assert code is not None
    assert (code.text, code.get("codeListValue")) == ("rawStdDev", "rawStdDev")
    text = root.findtext(".//{*}cornerPoints//{*}coordinates", "")  # southwest, then northeast
    assert [float(number) for number in re.split("[, ]", text)] == pytest.approx(corners)
    abstract = root.findtext(".//{*}abstract/{*}CharacterString", "")
    assert "mean sea level, positive up" in abstract
    assert "one standard deviation [m]" in abstract
    assert root.findtext(".//{*}citation//{*}title/{*}CharacterString") == "a <b> & c map"
    assert root.findtext(".//{*}citation//{*}Date") == "2023-11-14"  # of the last scan, at 1.7e9 s


@pytest.mark.skipif(not REAL.is_dir(), reason="shared/data/real/grids is not beside the checkout")
@pytest.mark.parametrize("name", ["georef_metadata_layer.bag", "sample-2.0.1.bag"])
def test_a_bag_has_the_structure_of_a_real_one(name: str, tmp_path: Path) -> None:
    write_bag(tmp_path / "grid.bag", sloping())
    paths = (
        "spatialRepresentationInfo//{*}axisDimensionProperties//{*}resolution/{*}Measure",
        "spatialRepresentationInfo//{*}cornerPoints/{*}Point/{*}coordinates",
        "referenceSystemInfo//{*}code/{*}CharacterString",
        "identificationInfo/{*}BAG_DataIdentification/{*}citation/{*}CI_Citation/{*}title",
        "identificationInfo/{*}BAG_DataIdentification/{*}verticalUncertaintyType/{*}BAG_VertUncertCode",
    )
    ours, real = metadata_of(tmp_path / "grid.bag"), metadata_of(REAL / name)
    for path in paths:
        tags = [[element.tag for element in root.findall(f"{{*}}{path}")] for root in (ours, real)]
        assert tags[0] == tags[1] != []
    with rasterio.open(REAL / name) as theirs, rasterio.open(tmp_path / "grid.bag") as bag:
        assert bag.descriptions == theirs.descriptions[:2]
        assert bag.nodatavals == theirs.nodatavals[:2]
        assert bag.dtypes == theirs.dtypes[:2]


def test_a_gdal_without_bag_is_refused(tmp_path: Path) -> None:
    with (
        patch("rasterio.Env.drivers", return_value={"GTiff": "GeoTIFF"}),
        pytest.raises(InputError, match="BAG driver"),
    ):
        write_bag(tmp_path / "grid.bag", sloping())
    assert not list(tmp_path.iterdir())
