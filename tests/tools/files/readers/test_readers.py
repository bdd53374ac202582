"""Every format gives the same scan, and what is dropped from it is noted; LAS and LAZ as laspy writes them."""

import struct
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pytest
from pyproj import CRS

from sonarmap.tools.files.readers.clouds import rows
from sonarmap.tools.files.readers.scans import read_scan, read_scans
from sonarmap.tools.files.time_scales import utc_of_gps
from tests.samples.cloud_files import POINTS, SAMPLES, STRENGTH, TABLE, las, npy, npz, pcd, ply, put, text
from tests.samples.places import DATA
from tests.samples.processor_time import thrifty
from tests.samples.refusals import refuses


@pytest.mark.parametrize("sample", [name for name in SAMPLES if name != "sonar"])
def test_every_format_gives_the_same_points_and_strengths(tmp_path, sample):
    suffix, content = SAMPLES[sample]
    read = read_scans([put(tmp_path / f"scan{suffix}", content)])
    (scan,) = read.scans
    np.testing.assert_array_equal(scan.points, POINTS)
    assert scan.strength is not None
    np.testing.assert_array_equal(scan.strength, STRENGTH)
    assert scan.points.dtype == scan.strength.dtype == np.float32
    assert (scan.name, scan.stamp, read.notes) == ("scan", 0.0, ())


@pytest.mark.parametrize(
    "name",
    ["intensity", "strength", "scalar_intensity", "scalar_Intensity", "amplitude", "reflectivity", "I", "Strength"],
)
def test_strength_goes_by_many_names(tmp_path, name):
    scan = read_scan(put(tmp_path / "scan.ply", ply(names=("X", "y", "Z", name))))
    np.testing.assert_array_equal(scan.points, POINTS)
    np.testing.assert_array_equal(scan.strength, STRENGTH)


@pytest.mark.parametrize(
    "content",
    [
        text(),
        text("  ", end="\r\n"),
        b"\xef\xbb\xbf" + text(","),
        "# a survey in the Weser, März\n\n".encode() + text(),
        text(",", '"X [m]","Y [m]","Z [m]","Intensity"\n'),
        text(" ", "x y z scalar_intensity\n"),
        text(";", "% made by hand\ni;z;y;x\n", (3, 2, 1, 0)),
        text(",", "time,strength,x,y,z\n", (0, 3, 0, 1, 2)),
        text(" ").replace(b"\n", b"\n# between\n\n"),
    ],
)
def test_text_comes_with_many_separators_headers_and_comments(tmp_path, content):
    scan = read_scan(put(tmp_path / "scan.txt", content))
    np.testing.assert_array_equal(scan.points, POINTS)
    np.testing.assert_array_equal(scan.strength, STRENGTH)


@pytest.mark.parametrize("separator", [None, b",", b";"])
def test_plain_numbers_are_those_of_python_to_the_bit(separator: bytes | None, monkeypatch: pytest.MonkeyPatch) -> None:
    """NumPy reads them, in a fourth of the time: the reading by Python, which names a faulty line, is not needed."""
    words = "1 -0 +1.5 1e400 -1e-400 nan -nan NaN inf -Inf .5 5. 4.9e-324 2.2250738585072011e-308 0.30000000000000004"
    numbers = [*words.split(), "9" * 400, f"0.{'3' * 900}"]
    expected = np.array([[float(number), float(number)] for number in numbers])
    between = (separator or b" \t").decode()
    text = "".join(f"{number}{between}{number}\r\n\n" for number in numbers).encode()
    monkeypatch.delattr(rows, "array")
    table = rows.parse_rows(rows.whole_lines(text, 1), 2, separator)
    np.testing.assert_array_equal(table.view(np.int64), expected.view(np.int64))


@pytest.mark.parametrize("kind", ["u2", ">i8", "f2"])
def test_integers_and_other_floats_are_coordinates_too(tmp_path, kind):
    whole = np.array([[1, 2, 3], [4, 5, 120], [7, 9, 8]])
    scan = read_scan(put(tmp_path / "scan.npy", npy(whole.astype(kind))))
    np.testing.assert_array_equal(scan.points, whole)


def test_bytes_after_the_last_point_are_noted(tmp_path):
    for name, content in {"a.ply": ply(), "b.pcd": pcd("binary"), "c.pcd": pcd("binary_compressed")}.items():
        (note,) = read_scans([put(tmp_path / name, content + b"\n\n")]).notes
        assert note.startswith(f"{name}: ignored 2 bytes")


def test_points_that_are_not_finite_are_dropped_and_counted(tmp_path):
    table = np.repeat(TABLE, 1000, axis=0)
    table[3, 1] = np.nan
    table[17, 0] = np.inf
    table[18, 2] = -np.inf
    read = read_scans([put(tmp_path / "scan3.npy", npy(table))])
    assert read.notes == ("scan3.npy: dropped 3 of 5,000 points that are NaN or infinite",)
    np.testing.assert_array_equal(read.scans[0].points, np.delete(table, [3, 17, 18], axis=0)[:, :3])
    np.testing.assert_array_equal(read.scans[0].strength, np.delete(table, [3, 17, 18], axis=0)[:, 3])


def test_invalid_strengths_become_zero_and_are_noted(tmp_path):
    table = TABLE.astype(np.float64)
    table[:4, 3] = [-1.0, np.nan, np.inf, 1e300]
    read = read_scans([put(tmp_path / "scan.npy", npy(table))])
    np.testing.assert_array_equal(read.scans[0].strength, [0, 0, 0, 0, 74.5])
    assert read.notes == ("scan.npy: set 4 of 5 strengths that are negative or not finite to 0",)


GPS = np.array([1.5, 1.0, 2.5, 3.0, 4.0]) + 415_000_000
RECORDED = datetime(2024, 11, 7, 7, 33, 3, tzinfo=UTC).timestamp()  # 1,415,000,001 s after 1980-01-06, less 18 s


def put_las(folder: Path, content: bytes, name: str = "a.laz") -> Path:
    return put(folder / name, content)


@pytest.mark.parametrize("compressed", [False, True])
@pytest.mark.parametrize(("form", "version"), [(0, "1.2"), (1, "1.2"), (3, "1.3"), (6, "1.4"), (7, "1.4"), (8, "1.4")])
def test_points_and_intensity_of_las_are_read(tmp_path: Path, form: int, version: str, compressed: bool) -> None:
    path = put_las(tmp_path, las(form=form, version=version, compressed=compressed), "a.laz" if compressed else "a.las")
    read = read_scans([path])
    np.testing.assert_array_equal(read.scans[0].points, POINTS)
    np.testing.assert_array_equal(read.scans[0].strength, np.round(STRENGTH))
    assert (read.scans[0].name, read.notes) == ("a", ())


def test_las_files_of_several_chunks_are_read(tmp_path: Path) -> None:
    """laspy divides points into chunks of 50,000."""
    rng = np.random.default_rng(3)
    table = np.hstack([rng.integers(-9000, 9000, (120_000, 3)) / 1024, rng.integers(0, 60_000, (120_000, 1))])
    for form in (3, 8):
        scan = read_scan(put_las(tmp_path, las(table, form=form)))
        np.testing.assert_array_equal(scan.points, table[:, :3].astype(np.float32))
        np.testing.assert_array_equal(scan.strength, table[:, 3])


class TestTimes:
    def test_the_stamp_is_the_first_in_utc(self, tmp_path: Path) -> None:
        assert read_scan(put_las(tmp_path, las(gps=GPS))).stamp == RECORDED
        assert utc_of_gps(np.array(0.0)) == 315_964_800
        assert utc_of_gps(np.array(1_167_264_016.0)) == datetime(2016, 12, 31, 23, 59, 59, tzinfo=UTC).timestamp()
        assert utc_of_gps(np.array(1_167_264_018.0)) == datetime(2017, 1, 1, tzinfo=UTC).timestamp()

    def test_seconds_of_a_week_are_no_stamp(self, tmp_path: Path) -> None:
        put_las(tmp_path, las(gps=GPS, adjusted=False), "a.laz")
        put_las(tmp_path, las(), "b.laz")
        assert [scan.stamp for scan in read_scans([tmp_path]).scans] == [0.0, 1.0]


def test_extra_dimensions_of_las_are_viewpoints(tmp_path: Path) -> None:
    places = {name: np.arange(5) * scale for name, scale in (("vp_x", 1.0), ("vp_y", -2.0), ("vp_z", 0.5))}
    scan = read_scan(put_las(tmp_path, las(extra=places)))
    np.testing.assert_array_equal(scan.viewpoints, np.column_stack(list(places.values())))


@pytest.mark.parametrize("times", [[1e308, 0, 1, 2, 3], [1e308, -1e308, 1, 2, 3], [1e60, 0, 1, 2, 3]])
def test_times_that_no_clock_has_are_left_out(tmp_path: Path, times: list[float]) -> None:
    scan = read_scan(put_las(tmp_path, las(gps=np.array(times), adjusted=False)))
    np.testing.assert_array_equal(scan.points, POINTS)
    assert scan.times is None


def test_map_coordinates_are_refused_with_their_system(tmp_path: Path) -> None:
    tile, offset = TABLE.astype(np.float64) + np.array([500_000, 6_651_000, 0, 0]), (500_000.0, 6_651_000.0, 0.0)
    words = (
        r"a\.laz: its points are in WGS 84 / UTM zone 32N: 5 of 5 points lie beyond 100 km .*look like map coordinates"
    )
    refuses(words, read_scan, put_las(tmp_path, las(tile, offset=offset, crs=CRS.from_epsg(32632))))
    words = r"these look like map coordinates .* subtract the sensor's position"
    refuses(words, read_scan, put_las(tmp_path, las(tile, offset=offset)))


COUNT, START, RECORDS = 247, 96, 100  # places in a header


class TestHostileHeaders:
    def refused(self, folder: Path, words: str, form: str, place: int, number: int, compressed: bool = True) -> None:
        """With this number at this place."""
        content = bytearray(las(compressed=compressed))
        struct.pack_into(form, content, place, number)
        with thrifty():
            refuses(words, read_scan, put_las(folder, bytes(content)))

    @pytest.mark.parametrize("compressed", [False, True])
    @pytest.mark.parametrize("count", [6, 2**63])
    def test_a_las_header_with_too_many_points_is_refused(self, tmp_path: Path, compressed: bool, count: int) -> None:
        self.refused(tmp_path, "a.laz", "<Q", COUNT, count, compressed)

    @pytest.mark.parametrize("place", [START, RECORDS])
    @pytest.mark.parametrize("number", [9, 2**32 - 1])
    def test_impossible_offsets_in_a_las_header_are_refused(self, tmp_path: Path, place: int, number: int) -> None:
        self.refused(tmp_path, "a.laz", "<I", place, number)

    def test_impossible_sizes_of_layers_and_chunks_are_refused(self, tmp_path: Path) -> None:
        """The process that unpacks them is bounded, or ends."""
        (start,) = struct.unpack_from("<I", las(), START)
        (table,) = struct.unpack_from("<q", las(), start)
        for place, number in (
            *((start + 8 + 34 + 4 * layer, 2**32 - 16) for layer in range(9)),
            (table + 4, 2**32 - 1),
        ):
            self.refused(tmp_path, "a.laz: it.*(cut or damaged|takes more memory)", "<I", place, number)


def test_three_columns_carry_no_strength(tmp_path):
    for name, content in {"a.xyz": text(columns=(0, 1, 2)), "b.npy": npy(POINTS), "c.npz": npz(points=POINTS)}.items():
        scan = read_scan(put(tmp_path / name, content))
        np.testing.assert_array_equal(scan.points, POINTS)
        assert scan.strength is None


@pytest.mark.slow
def test_real_rgbd_fragments_are_read_whole():
    files = sorted((DATA / "redkitchen").glob("*.ply"))
    if not files:
        pytest.skip(f"no real fragments in {DATA / 'redkitchen'}")
    read = read_scans(files)
    assert [len(scan.points) for scan in read.scans] == [258342, 268977, 291605]
    assert [scan.name for scan in read.scans] == ["cloud_bin_0", "cloud_bin_1", "cloud_bin_2"]
    assert read.notes == ()
    o3d = pytest.importorskip("open3d")
    witness = np.asarray(o3d.io.read_point_cloud(str(files[0])).points)
    np.testing.assert_array_equal(read.scans[0].points, witness.astype(np.float32))
