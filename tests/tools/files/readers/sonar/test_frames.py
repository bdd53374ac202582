"""Range images of Sonar 3D-15 recordings: frame conventions, strengths, other messages, wrong content."""

import re
import struct

import numpy as np
import pytest
import snappy
from google.protobuf.timestamp_pb2 import Timestamp
from wlsonar import bitmap_image_to_strength_linear, range_image_to_xyz
from wlsonar import range_image_protocol as rip

from sonarmap.kernels.errors import InputError
from sonarmap.tools.files.readers.scans import read_scan, read_scans, read_survey
from tests.samples.cloud_files import SAMPLES, put, sonar_packets
from tests.samples.recordings import range_image, read_sonar, strength_image, with_checksum
from tests.samples.refusals import refuses

pytestmark = pytest.mark.filterwarnings("error")


def test_points_equal_those_of_wlsonar_with_y_and_z_turned():
    rng = np.random.default_rng(3)
    image = range_image(0, rng.integers(0, 90, (7, 11)))
    theirs = np.array([point for point in range_image_to_xyz(image) if point is not None])
    (cloud,) = read_sonar(rip.packb(image))
    np.testing.assert_allclose(cloud.points, theirs * [1, -1, -1], atol=1e-12)


def test_strengths_are_linear_and_belong_to_their_pixels():
    rng = np.random.default_rng(4)
    pixels, levels = rng.integers(0, 3, (7, 11)), rng.integers(0, 256, (7, 11))
    levels[0] = 0
    image = strength_image(5, levels)
    theirs = np.array(bitmap_image_to_strength_linear(image))[pixels.ravel() > 0]
    for packets in ([range_image(5, pixels), image], [image, range_image(5, pixels)]):
        (cloud,) = read_sonar(b"".join(rip.packb(message) for message in packets))
        assert cloud.strength is not None
        np.testing.assert_allclose(cloud.strength, theirs, atol=0.5)  # wlsonar rounds
        assert (cloud.strength == 0).any()
        assert (cloud.strength > 0).any()


def test_each_frame_is_a_scan_with_stamp_and_name(tmp_path):
    path = put(tmp_path / "dive.sonar", SAMPLES["sonar"][1])
    read = read_scans([path])
    assert [scan.name for scan in read.scans] == ["dive#0", "dive#1", "dive#2"]
    assert [scan.stamp for scan in read.scans] == [1_700_000_000.25, 1_700_000_001.25, 1_700_000_002.25]
    assert [len(scan.points) for scan in read.scans] == [11, 11, 11]
    assert read.notes == ()
    chosen = read_scan(f"{path}#1")
    assert chosen.name == "dive#1"
    np.testing.assert_array_equal(chosen.points, read.scans[1].points)
    assert [scan.name for scan in read_scans([f"{path}#2", f"{path}#0"]).scans] == ["dive#0", "dive#2"]
    refuses(r"holds 3 scans.*file\.sonar#3", read_scan, path)
    refuses("holds scans #0 to #2", read_scan, f"{path}#3")


def test_other_messages_are_ignored():
    shaded = strength_image(0, np.full((3, 4), 9))
    shaded.type = rip.BitmapImageType.SHADED_IMAGE
    strangers = [rip.packb(rip.ImuBatch(samples=1)), rip.packb(Timestamp(seconds=5)), rip.packb(shaded)]
    plain = read_sonar(b"".join(sonar_packets()))
    mixed = read_sonar(b"".join(one for pair in zip(sonar_packets(), strangers * 2, strict=True) for one in pair))
    for ours, theirs in zip(plain, mixed, strict=True):
        np.testing.assert_array_equal(ours.points, theirs.points)
        np.testing.assert_array_equal(ours.strength, theirs.strength)


def test_frames_without_strength_or_echo_are_noted(tmp_path):
    packets = sonar_packets()
    empty = rip.packb(range_image(1, np.zeros((3, 4), int)))
    read = read_scans([put(tmp_path / "dive.sonar", b"".join([packets[0], packets[1], empty, packets[4]]))])
    assert [scan.name for scan in read.scans] == ["dive#0", "dive#2"]
    assert read.notes == (
        "dive.sonar: 2 of 3 shots have no strength image",
        "dive.sonar: 1 of 3 scans were skipped, as they have no points: #1",
    )
    (tmp_path / "void.sonar").write_bytes(empty)
    refuses(r"void\.sonar: no points", read_scans, [tmp_path / "void.sonar"])
    refuses(r"dive\.sonar#1: no points", read_scan, tmp_path / "dive.sonar#1")


@pytest.mark.parametrize("compressed", [True, False])
def test_damage_under_a_right_checksum_is_refused_or_harmless(tmp_path, compressed):
    """What a checksum cannot tell: every layer below it must hold too."""
    rng = np.random.default_rng(6)
    message = rip.packb(range_image(1, np.arange(12).reshape(3, 4)), protocol=rip.ProtocolVersion.RIP1)[8:-4]
    for _ in range(150):
        payload = bytearray(snappy.compress(message) if compressed else message)
        for _ in range(rng.integers(1, 4)):
            payload[rng.integers(len(payload))] = rng.integers(256)
        body = (b"RIP2" if compressed else b"RIP1") + struct.pack("<I", len(payload) + 12) + payload
        (tmp_path / "dive.sonar").write_bytes(with_checksum(body + bytes(4)))
        try:
            (scan,) = read_scans([tmp_path / "dive.sonar"]).scans
        except InputError:
            continue
        assert np.isfinite(scan.points).all()


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"width": 5}, "of 5 x 3 with 12 pixels"),
        ({"fov_horizontal": 0.0}, "with fields of view"),
        ({"fov_vertical": float("nan")}, "with fields of view"),
        ({"image_pixel_scale": float("inf")}, "scale inf"),
        ({"image_pixel_scale": -1.0}, "scale -1"),
    ],
)
def test_range_images_that_contradict_themselves_are_refused(change, said):
    image = range_image(0, np.arange(12).reshape(3, 4))
    for name, value in change.items():
        setattr(image, name, value)
    refuses(f"packet 1 at byte 0 is a range image .*{said}", read_sonar, rip.packb(image))


def test_a_frame_of_nan_leaves_a_gap(tmp_path):
    frames = [range_image(frame, np.full((3, 4), 80)) for frame in range(3)]
    frames[1].image_pixel_scale = float("nan")
    path = put(tmp_path / "dive.sonar", b"".join(rip.packb(frame) for frame in frames))
    refuses(r"dive\.sonar#1: dropped 12 of 12 points that are NaN", read_scans, [path])
    read = read_survey([path])
    assert [scan.name for scan in read.scans] == ["dive#0", "dive#2"]
    assert [scan.stamp - read.scans[0].stamp for scan in read.scans] == [0, 2]
    (unread,) = read.unread
    assert (unread.where, unread.before) == (f"{path}#1", 1)


def test_packets_of_the_first_version_and_without_time_are_read(tmp_path):
    image = range_image(0, np.arange(12).reshape(3, 4))
    old = rip.packb(image, protocol=rip.ProtocolVersion.RIP1)
    np.testing.assert_array_equal(read_sonar(old)[0].points, read_sonar(rip.packb(image))[0].points)
    image.header.ClearField("timestamp")
    assert read_scan(put(tmp_path / "dive.sonar", rip.packb(image))).stamp == 0.0  # it takes the counter


@pytest.mark.parametrize("first", [True, False])
def test_a_strength_image_of_another_size_is_left_out(first):
    packets = [sonar_packets()[0], rip.packb(strength_image(0, np.ones((4, 3))))]
    notes: list[str] = []
    (cloud,) = read_sonar(b"".join(packets if first else packets[::-1]), notes)
    assert (len(cloud.points), cloud.strength) == (11, None)
    (note,) = notes
    damage = "is a strength image of 3 x 4 with 12 pixels beside a range image of 4 x 3"
    assert re.search(f"1 damaged packet left out.*bytes: packet 2 at byte.*{damage}", note)
