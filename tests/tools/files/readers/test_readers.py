"""Every format gives the same scan, and what is dropped from it is told."""

import numpy as np
import pytest

from sonarmap.tools.files.readers.scans import read_scan, read_scans
from tests.samples.cloud_files import POINTS, SAMPLES, STRENGTH, TABLE, npy, npz, pcd, ply, put, text
from tests.samples.places import DATA


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
        text("\t"),
        text(","),
        text(", "),
        text(";"),
        text("  ", end="\r\n"),
        b"\xef\xbb\xbf" + text(","),
        "# a survey in the Weser, März\n\n".encode() + text(),
        text(",", "x,y,z,intensity\n"),
        text(",", '"X [m]","Y [m]","Z [m]","Intensity"\n'),
        text(";", 'X [m];Y(m) ;"z [m]";I\n'),
        text(" ", "x y z scalar_intensity\n"),
        text("\t", "X [m]\tY [m]\tZ [m]\tI\n"),
        text(",", "//X,Y,Z,Intensity\n"),
        text(";", "% made by hand\ni;z;y;x\n", (3, 2, 1, 0)),
        text(",", "time,strength,x,y,z\n", (0, 3, 0, 1, 2)),
        text(" ").replace(b"\n", b"\n# between\n\n"),
        text(" ").replace(b"30.5", b"+3.05e1"),
    ],
)
def test_text_comes_with_many_separators_headers_and_comments(tmp_path, content):
    scan = read_scan(put(tmp_path / "scan.txt", content))
    np.testing.assert_array_equal(scan.points, POINTS)
    np.testing.assert_array_equal(scan.strength, STRENGTH)


def test_three_columns_carry_no_strength(tmp_path):
    bare = text(columns=(0, 1, 2))
    for name, content in {"a.xyz": bare, "b.npy": npy(POINTS), "c.npz": npz(points=POINTS)}.items():
        scan = read_scan(put(tmp_path / name, content))
        np.testing.assert_array_equal(scan.points, POINTS)
        assert scan.strength is None


@pytest.mark.parametrize("kind", ["i1", "u2", "<i4", ">i8", "f2", "f8"])
def test_integers_and_other_floats_are_coordinates_too(tmp_path, kind):
    whole = np.array([[1, 2, 3], [4, 5, 120], [7, 9, 8]])
    scan = read_scan(put(tmp_path / "scan.npy", npy(whole.astype(kind))))
    np.testing.assert_array_equal(scan.points, whole)


def test_integer_columns_of_a_ply_are_coordinates_too(tmp_path):
    header = "ply\nformat {} 1.0\nelement vertex 2\nproperty int x\nproperty uchar y\nproperty short z\nend_header\n"
    words = np.array([(-70000, 200, -300), (5, 6, 7)], [("x", "<i4"), ("y", "u1"), ("z", "<i2")])
    binary = header.format("binary_little_endian").encode() + words.tobytes()
    plain = header.format("ascii").encode() + b"-70000 200 -300\n5 6 7\n"
    for content in (binary, plain):
        scan = read_scan(put(tmp_path / "scan.ply", content))
        np.testing.assert_array_equal(scan.points, [[-70000, 200, -300], [5, 6, 7]])


def test_bytes_after_the_last_point_are_told(tmp_path):
    for name, content in {"a.ply": ply(), "b.pcd": pcd("binary"), "c.pcd": pcd("binary_compressed")}.items():
        (note,) = read_scans([put(tmp_path / name, content + b"\n\n")]).notes
        assert note.startswith(f"{name}: ignored 2 bytes")


def test_points_that_are_not_finite_are_dropped_counted_and_told(tmp_path):
    table = np.repeat(TABLE, 1000, axis=0)
    table[3, 1] = np.nan
    table[17, 0] = np.inf
    table[18, 2] = -np.inf
    read = read_scans([put(tmp_path / "scan3.npy", npy(table))])
    assert read.notes == ("scan3.npy: dropped 3 of 5,000 points that are NaN or infinite",)
    np.testing.assert_array_equal(read.scans[0].points, np.delete(table, [3, 17, 18], axis=0)[:, :3])
    np.testing.assert_array_equal(read.scans[0].strength, np.delete(table, [3, 17, 18], axis=0)[:, 3])


def test_strengths_that_mean_nothing_become_zero_and_are_told(tmp_path):
    table = TABLE.astype(np.float64)
    table[:4, 3] = [-1.0, np.nan, np.inf, 1e300]
    read = read_scans([put(tmp_path / "scan.npy", npy(table))])
    np.testing.assert_array_equal(read.scans[0].strength, [0, 0, 0, 0, 74.5])
    assert read.notes == ("scan.npy: set 4 of 5 strengths that are negative or not finite to 0",)


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
