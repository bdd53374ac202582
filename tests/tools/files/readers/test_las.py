"""LAS and LAZ as laspy writes them."""

import struct
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pytest
from pyproj import CRS

from sonarmap.kernels.errors import InputError
from sonarmap.tools.files.readers.scans import read_scan, read_scans
from sonarmap.tools.files.time_scales import utc_of_gps
from tests.samples.cloud_files import POINTS, STRENGTH, TABLE, las
from tests.samples.processor_time import thrifty

GPS = np.array([1.5, 1.0, 2.5, 3.0, 4.0]) + 415_000_000
RECORDED = datetime(2024, 11, 7, 7, 33, 3, tzinfo=UTC).timestamp()  # 1,415,000,001 s after 1980-01-06, less 18 s


def put(folder: Path, content: bytes, name: str = "a.laz") -> Path:
    (folder / name).write_bytes(content)
    return folder / name


@pytest.mark.parametrize("compressed", [False, True])
@pytest.mark.parametrize(("form", "version"), [(0, "1.2"), (1, "1.2"), (3, "1.3"), (6, "1.4"), (7, "1.4"), (8, "1.4")])
def test_points_and_intensity_of_every_form(tmp_path: Path, form: int, version: str, compressed: bool) -> None:
    path = put(tmp_path, las(form=form, version=version, compressed=compressed), "a.laz" if compressed else "a.las")
    read = read_scans([path])
    np.testing.assert_array_equal(read.scans[0].points, POINTS)
    np.testing.assert_array_equal(read.scans[0].strength, np.round(STRENGTH))
    assert (read.scans[0].name, read.notes) == ("a", ())


def test_several_chunks(tmp_path: Path) -> None:
    """laspy divides points into chunks of 50,000."""
    rng = np.random.default_rng(3)
    table = np.hstack([rng.integers(-9000, 9000, (120_000, 3)) / 1024, rng.integers(0, 60_000, (120_000, 1))])
    for form in (3, 8):
        scan = read_scan(put(tmp_path, las(table, form=form)))
        np.testing.assert_array_equal(scan.points, table[:, :3].astype(np.float32))
        np.testing.assert_array_equal(scan.strength, table[:, 3])


class TestTimes:
    def test_the_stamp_is_the_first_in_utc(self, tmp_path: Path) -> None:
        assert read_scan(put(tmp_path, las(gps=GPS))).stamp == RECORDED
        assert utc_of_gps(np.array(0.0)) == 315_964_800
        assert utc_of_gps(np.array(1_167_264_016.0)) == datetime(2016, 12, 31, 23, 59, 59, tzinfo=UTC).timestamp()
        assert utc_of_gps(np.array(1_167_264_018.0)) == datetime(2017, 1, 1, tzinfo=UTC).timestamp()

    def test_seconds_of_a_week_are_no_stamp(self, tmp_path: Path) -> None:
        put(tmp_path, las(gps=GPS, adjusted=False), "a.laz")
        put(tmp_path, las(), "b.laz")
        assert [scan.stamp for scan in read_scans([tmp_path]).scans] == [0.0, 1.0]

    def test_a_trajectory_beside_gives_viewpoints(self, tmp_path: Path) -> None:
        """Its stamps are the GPS times of the file."""
        (tmp_path / "a.tum").write_text("415000000 0 0 0 0 0 0 1\n415000005 10 0 -5 0 0 0 1\n")
        scan = read_scan(put(tmp_path, las(gps=GPS)))
        after = GPS - 415_000_000
        expected = np.column_stack([2 * after, 0 * after, -after])
        np.testing.assert_allclose(np.asarray(scan.viewpoints), expected, atol=1e-6)


def test_viewpoints_as_extra_dimensions(tmp_path: Path) -> None:
    places = {name: np.arange(5) * scale for name, scale in (("vp_x", 1.0), ("vp_y", -2.0), ("vp_z", 0.5))}
    scan = read_scan(put(tmp_path, las(extra=places)))
    np.testing.assert_array_equal(scan.viewpoints, np.column_stack(list(places.values())))


def test_map_coordinates_are_refused_with_their_system(tmp_path: Path) -> None:
    tile = TABLE.astype(np.float64) + np.array([500_000, 6_651_000, 0, 0])
    content = las(tile, offset=(500_000.0, 6_651_000.0, 0.0), crs=CRS.from_epsg(32632))
    with pytest.raises(InputError, match=r"a\.laz: its points are map coordinates in WGS 84 / UTM zone 32N: x 5000"):
        read_scan(put(tmp_path, content))
    with pytest.raises(InputError, match=r"in an unnamed system: .* subtract the sensor's place"):
        read_scan(put(tmp_path, las(tile, offset=(500_000.0, 6_651_000.0, 0.0))))


COUNT, LEGACY_COUNT, START, RECORDS = 247, 107, 96, 100  # places in a header


class TestHostileHeaders:
    def refused(self, folder: Path, words: str, form: str, place: int, number: int, compressed: bool = True) -> None:
        """With this number at this place."""
        content = bytearray(las(compressed=compressed))
        struct.pack_into(form, content, place, number)
        with thrifty(), pytest.raises(InputError, match=words):
            read_scan(put(folder, bytes(content)))

    @pytest.mark.parametrize("compressed", [False, True])
    @pytest.mark.parametrize("count", [6, 10**9, 10**12, 2**63])
    def test_more_points_than_there_are(self, tmp_path: Path, compressed: bool, count: int) -> None:
        self.refused(tmp_path, "a.laz", "<Q", COUNT, count, compressed)

    @pytest.mark.parametrize("place", [START, RECORDS])
    @pytest.mark.parametrize("number", [0, 9, 2**31, 2**32 - 1])
    def test_records_and_offsets_without_end(self, tmp_path: Path, place: int, number: int) -> None:
        self.refused(tmp_path, "a.laz", "<I", place, number)

    def test_layers_and_chunks_without_end(self, tmp_path: Path) -> None:
        (start,) = struct.unpack_from("<I", las(), START)
        (table,) = struct.unpack_from("<q", las(), start)
        layers = r"the layers of chunk 0 claim 4,29\d,\d{3},\d{3} bytes"
        for layer in range(9):
            self.refused(tmp_path, layers, "<I", start + 8 + 30 + 4 + 4 * layer, 2**32 - 16)
        self.refused(tmp_path, "it claims 4,294,967,295 chunks of 5 points", "<I", table + 4, 2**32 - 1)
