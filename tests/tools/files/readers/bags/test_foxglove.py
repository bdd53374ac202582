"""foxglove.PointCloud in MCAP, as the MCAP project's and Foxglove's own libraries write it."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from mcap.writer import Writer as PlainWriter

from sonarmap.kernels.errors import InputError
from sonarmap.tools.files.readers.bags.clouds import cloud_of
from sonarmap.tools.files.readers.bags.mcap_file import open_mcap
from sonarmap.tools.files.readers.scans import read_scan, read_scans
from tests.samples.bags.foxglove import point_cloud, written
from tests.samples.bags.messages import STAMP
from tests.samples.cloud_files import POINTS, STRENGTH, TABLE


def test_points_strengths_and_stamps(tmp_path: Path) -> None:
    read = read_scans([written(tmp_path / "dive.mcap", point_cloud(0), point_cloud(1, TABLE * 2))])
    assert [(scan.name, scan.stamp) for scan in read.scans] == [("dive#0", STAMP + 0.25), ("dive#1", STAMP + 1.25)]
    for k, scan in enumerate(read.scans):
        np.testing.assert_array_equal(scan.points, POINTS * (k + 1))
        np.testing.assert_array_equal(scan.strength, STRENGTH * (k + 1))


def test_the_pose_of_a_cloud_in_its_frame(tmp_path: Path) -> None:
    message = point_cloud()
    message.pose.position.x, message.pose.position.z = 3, -0.5
    message.pose.orientation.z = message.pose.orientation.w = np.sqrt(0.5)
    scan = read_scan(written(tmp_path / "a.mcap", message))
    x, y, z = POINTS.T
    np.testing.assert_allclose(scan.points, np.column_stack([3 - y, x, z - 0.5]), atol=1e-6)
    np.testing.assert_allclose(np.asarray(scan.viewpoints), np.tile([3, 0, -0.5], (5, 1)), atol=1e-6)


@pytest.mark.parametrize("stride", [0, 7, 2**31])
def test_strides_that_do_not_fit(tmp_path: Path, stride: int) -> None:
    message = point_cloud()
    message.point_stride = stride
    with pytest.raises(InputError, match=r"message 0 of /points: it holds 130 bytes, .* not a number of points of"):
        read_scan(written(tmp_path / "a.mcap", message))


def test_a_frame_that_is_no_text(tmp_path: Path) -> None:
    """By a schema that is damaged."""
    (message,) = open_mcap(written(tmp_path / "a.mcap", point_cloud())).messages(["/points"], [])
    as_number = message.schema.replace(b"frame_id\x18\x02 \x01(\t", b"frame_id\x18\x02 \x01(\x01")
    assert as_number != message.schema
    with pytest.raises(InputError, match=r"its foxglove.* contradicts itself"):
        cloud_of(replace(message, schema=as_number))


def test_clouds_as_json_are_refused(tmp_path: Path) -> None:
    with (tmp_path / "a.mcap").open("wb") as file:
        writer = PlainWriter(file)
        writer.start()
        schema = writer.register_schema("foxglove.PointCloud", "jsonschema", b"{}")
        channel = writer.register_channel("/points", "json", schema)
        writer.add_message(channel, 0, b"{}", 0)
        writer.finish()
    with pytest.raises(InputError, match=r"its foxglove\.PointCloud is encoded as 'json'; wanted cdr, ros1 or proto"):
        read_scan(tmp_path / "a.mcap")
