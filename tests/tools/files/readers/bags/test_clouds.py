"""Clouds of bags and MCAP files as other libraries write them, in every layout that a message may have."""

import re
import tracemalloc
from pathlib import Path

import numpy as np
import pytest
from mcap.writer import Writer as PlainWriter

from sonarmap.tools.files.readers.bags.recording import Unpacker
from sonarmap.tools.files.readers.file import clouds_of
from sonarmap.tools.files.readers.scans import read_scan, read_scans, read_survey
from sonarmap.tools.files.readers.selection import SelectedFile
from tests.samples.bags.foxglove import point_cloud
from tests.samples.bags.foxglove import written as write_foxglove
from tests.samples.bags.messages import CLOUD, FIELDS, STAMP, cloud
from tests.samples.bags.writers import WRITERS, Record, write_mcap, write_ros1, write_ros2
from tests.samples.cloud_files import POINTS, STRENGTH, TABLE
from tests.samples.refusals import refuses

TIMES = [STAMP + 0.25, STAMP + 0.5, STAMP + 1.125]
CHATTER: Record = ("/chatter", "std_msgs/msg/Header", 1.0, {"stamp": {"sec": 1, "nanosec": 2}, "frame_id": "x"})


def single(message: dict) -> list[Record]:
    """A recording of one cloud."""
    return [("/p", CLOUD, 1.0, message)]


def dive(topic: str = "/sonar/points", **options: object) -> list[Record]:
    """Three clouds, each twice as far off as the one before, that were recorded an eighth of a second late."""
    return [
        (topic, CLOUD, time + 0.125, cloud(TABLE * np.float32(2**k), time, **options)) for k, time in enumerate(TIMES)
    ]


@pytest.mark.parametrize("writer", WRITERS)
def test_every_kind_of_recording_gives_the_same_scans(tmp_path: Path, writer: str) -> None:
    read = read_scans([WRITERS[writer](tmp_path, dive())])
    assert [scan.name for scan in read.scans] == ["dive#0", "dive#1", "dive#2"]
    assert [scan.stamp for scan in read.scans] == TIMES
    for k, scan in enumerate(read.scans):
        np.testing.assert_array_equal(scan.points, POINTS * 2**k)
        np.testing.assert_array_equal(scan.strength, STRENGTH * 2**k)
        assert scan.viewpoints is None
    assert read.notes == ()


@pytest.mark.parametrize("writer", ["ros1", "mcap", "sqlite"])
def test_messages_are_streamed_in_little_memory(tmp_path: Path, writer: str) -> None:
    """40 clouds of 1 MB each."""
    large = np.tile(TABLE, (7000, 1))
    path = WRITERS[writer](tmp_path, [("/p", CLOUD, float(k), cloud(large, k + 1.0)) for k in range(40)])
    tracemalloc.start()
    counts = [len(named.cloud.points) for named in clouds_of(SelectedFile(path), [])]
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert counts == [35_000] * 40
    assert peak < 15e6


class TestLayouts:
    @pytest.mark.parametrize("writer", ["ros1", "mcap"])
    @pytest.mark.parametrize("big", [False, True])
    @pytest.mark.parametrize(("rows", "padding"), [(1, 0), (5, 7), (5, 0)])
    def test_rows_padding_and_byte_order_are_read(self, tmp_path, writer, big, rows, padding) -> None:
        scan = read_scan(WRITERS[writer](tmp_path, single(cloud(rows=rows, padding=padding, big=big))))
        np.testing.assert_array_equal(scan.points, POINTS)
        np.testing.assert_array_equal(scan.strength, STRENGTH)

    @pytest.mark.parametrize("writer", ["ros1", "mcap", "sqlite"])
    def test_a_single_row_needs_no_row_step(self, tmp_path: Path, writer: str) -> None:
        message = cloud() | {"row_step": 0}
        np.testing.assert_array_equal(read_scan(WRITERS[writer](tmp_path, single(message))).points, POINTS)
        rows = write_mcap(tmp_path / "rows.mcap", single(cloud(rows=5) | {"row_step": 0}))
        refuses("points of 30 bytes, 1 in rows of 0, do not hold its fields", read_scan, rows)

    @pytest.mark.parametrize("big", [False, True])
    @pytest.mark.parametrize("dtype", ["i1", "u2", "i4", "f8"])
    def test_fields_of_every_type_are_read(self, tmp_path: Path, dtype: str, big: bool) -> None:
        table = np.array([[1, 2, 3, 4], [50, 60, 70, 80]], np.float32) * (-1 if dtype[0] != "u" else 1)
        table[:, 3] = [9, 10]
        fields = [(name, dtype, 9 * k + 1) for k, name in enumerate(("x", "y", "z", "intensity"))]
        message = cloud(table, fields=fields, step=40, big=big)
        scan = read_scan(write_mcap(tmp_path / "a.mcap", single(message)))
        np.testing.assert_array_equal(scan.points, table[:, :3])
        np.testing.assert_array_equal(scan.strength, table[:, 3])

    @pytest.mark.parametrize("dense", [False, True])
    def test_beams_without_an_echo_are_no_points(self, tmp_path: Path, dense: bool) -> None:
        """Nobody misses them but in a cloud that calls itself dense."""
        gaps = np.array([[np.nan] * 4, *TABLE.tolist()], np.float32)
        read = read_scans([write_mcap(tmp_path / "a.mcap", single(cloud(gaps, rows=2, dense=dense)))])
        np.testing.assert_array_equal(read.scans[0].points, POINTS)
        assert read.notes == ("a.mcap: dropped 1 of 6 points that are NaN or infinite",) * dense

    def test_empty_clouds_are_skipped_and_keep_their_numbers(self, tmp_path: Path) -> None:
        records = dive()
        records[1] = ("/sonar/points", CLOUD, TIMES[1], cloud(TABLE[:0], TIMES[1]))
        records[2][3]["is_dense"] = False
        read = read_scans([write_mcap(tmp_path / "dive.mcap", records)])
        assert [scan.name for scan in read.scans] == ["dive#0", "dive#2"]
        assert read.notes == ("dive.mcap: 1 of 3 scans were skipped, as they have no points: #1",)

    def test_the_time_of_recording_replaces_a_missing_stamp(self, tmp_path: Path) -> None:
        records = [("/p", CLOUD, 7.5 + k, cloud(stamp=0)) for k in range(2)]
        read = read_scans([write_mcap(tmp_path / "a.mcap", records)])
        assert [scan.stamp for scan in read.scans] == [7.5, 8.5]
        assert read.notes == ("a.mcap: 2 headers have no stamp: the times are those at which they were recorded",)

    @pytest.mark.parametrize(
        ("change", "words"),
        [
            ({"row_step": 149}, "points of 30 bytes, 5 in rows of 149, do not hold its fields"),
            ({"point_step": 27, "row_step": 135}, "points of 27 bytes, 5 in rows of 135, do not hold its fields"),
            ({"height": 2}, "2 x 5 points take 300 bytes, and it holds 150"),
            ({"width": 2**32 - 1}, "do not hold its fields"),
            ({"height": 2**32 - 1, "row_step": 2**32 - 1}, "bytes, and it holds 150"),
            ({"fields": [{"name": "x", "offset": 0, "datatype": 7, "count": 1}]}, "no column y, z"),
            ({"fields": [field | {"datatype": 9} for field in cloud()["fields"]]}, "field x has an unknown data type"),
        ],
    )
    def test_contradictory_messages_are_refused(self, tmp_path: Path, change: dict, words: str) -> None:
        path = write_mcap(tmp_path / "a.mcap", single(cloud() | change))
        refuses(rf"a\.mcap: message 0 of /p: .*{words}", read_scan, path)

    def test_a_message_that_cannot_be_used_leaves_a_gap(self, tmp_path: Path) -> None:
        records = dive()
        records[1][3]["width"] = 9
        read = read_survey([write_ros1(tmp_path / "dive.bag", records)])
        assert [scan.name for scan in read.scans] == ["dive#0", "dive#2"]
        assert "dive.bag: message 1 of /sonar/points: its points of 30 bytes, 9 in rows of 150" in read.notes[0]


@pytest.mark.parametrize(
    ("name", "dtype", "values"),
    [
        ("t", "u4", [0, 250_000_000, 500_000_000, 750_000_000, 1_000_000_000]),  # Ouster
        ("time", "f4", [0, 0.25, 0.5, 0.75, 1]),  # Velodyne
        ("timestamp", "f8", [STAMP + k / 4 for k in range(5)]),  # Hesai
        ("timestamp", "f8", [(STAMP + k / 4) * 1e9 for k in range(5)]),  # Livox
    ],
)
def test_times_of_points_become_seconds_in_utc(tmp_path: Path, name: str, dtype: str, values: list[float]) -> None:
    names = ("x", "y", "z", "intensity", name)
    table = np.column_stack([TABLE, values])
    message = cloud(table, STAMP, names=names, fields=[*FIELDS, (name, dtype, 32)], step=40)
    write_mcap(tmp_path / "a.mcap", single(message))
    scan = read_scan(tmp_path / "a.mcap")  # its times count from the stamp
    np.testing.assert_allclose(np.asarray(scan.times), [k / 4 for k in range(5)], atol=1e-6)


class TestTopics:
    @staticmethod
    def two(folder: Path) -> Path:
        return write_ros2(folder / "dive", dive("/port/points") + dive("/starboard/points")[:2])

    def test_one_of_several_topics_has_to_be_named(self, tmp_path: Path) -> None:
        path = self.two(tmp_path)
        words = (
            f"{path}: it has 2 topics of {CLOUD} or foxglove.PointCloud: /port/points (3 of {CLOUD}), "
            f"/starboard/points (2 of {CLOUD}); choose one, as in {path}::/port/points"
        )
        refuses(f"^{re.escape(words)}$", read_scans, [path])

    def test_topics_and_scans_are_chosen_behind_the_path(self, tmp_path: Path) -> None:
        path = self.two(tmp_path)
        for name, count in (("/port/points", 3), ("starboard/points", 2)):
            assert [scan.name for scan in read_scans([f"{path}::{name}"]).scans] == [f"dive#{k}" for k in range(count)]
        np.testing.assert_array_equal(read_scan(f"{path}::/port/points#2").points, POINTS * 4)
        np.testing.assert_array_equal(read_scan(f"{path}/dive.db3::/port/points#1").points, POINTS * 2)
        read = read_scans([f"{path}::/port/points", f"{path}::/starboard/points"])
        assert [scan.name for scan in read.scans][2:4] == [f"{path}::/port/points#2", f"{path}::/starboard/points#0"]
        assert read.surveys == (0, 0, 0, 0, 0)
        assert sorted(file.name for file in read.files) == ["dive.db3", "metadata.yaml"]

    @pytest.mark.parametrize(
        ("topic", "words"),
        [
            ("/stern", "no topic /stern; its topics are /chatter (1 of std_msgs/msg/Header), /sonar/points (3 of"),
            ("/chatter", "its topic /chatter has 1 messages of type std_msgs/msg/Header; wanted sensor_msgs/"),
        ],
    )
    def test_unknown_topics_and_topics_without_clouds_are_refused(self, tmp_path: Path, topic: str, words: str) -> None:
        path = write_mcap(tmp_path / "a.mcap", [CHATTER, *dive()])
        assert len(read_scans([path]).scans) == 3
        refuses(re.escape(words), read_scans, [f"{path}::{topic}"])

    def test_recordings_without_clouds_and_topics_of_other_files_are_refused(self, tmp_path: Path) -> None:
        words = r"no messages of type sensor_msgs/msg/PointCloud2 or .* are /chatter"
        refuses(words, read_scans, [write_ros1(tmp_path / "a.bag", [CHATTER])])
        (tmp_path / "a.xyz").write_text("1 2 3\n")
        refuses("::/points names a topic, but text has none; leave it out", read_scans, [f"{tmp_path}/a.xyz::/points"])


class TestFolders:
    def test_a_bag_is_read_among_other_files(self, tmp_path: Path) -> None:
        write_ros2(tmp_path / "dive", dive())
        (tmp_path / "a.xyz").write_text("1 2 3\n")
        for path in (tmp_path, tmp_path / "*"):
            assert [scan.name for scan in read_scans([path]).scans] == ["a", "dive#0", "dive#1", "dive#2"]

    def test_split_bags_continue_in_the_next_file_and_each_bag_is_a_survey(self, tmp_path: Path) -> None:
        paths = [write_ros2(tmp_path / name, dive()[:2]) for name in ("a", "b")]
        assert read_scans(paths).surveys == (0, 0, 1, 1)
        folder = write_ros2(tmp_path / "dive", dive()[:1], mcap=True)
        write_mcap(folder / "dive_10.mcap", dive()[2:])
        write_mcap(folder / "dive_9.mcap", dive()[1:2])
        (folder / "dive_9.mcap.zstd").write_bytes(b"compressed, and there unpacked too")
        assert [scan.stamp for scan in read_scans([folder]).scans] == TIMES
        (folder / "dive_9.mcap.zstd").unlink()
        for file in folder.glob("*.mcap"):
            file.unlink()
        refuses(r"dive: it has no file \.db3 or \.mcap; copy the whole folder", read_scans, [folder])


def test_points_strengths_and_stamps_of_foxglove_are_read(tmp_path: Path) -> None:
    read = read_scans([write_foxglove(tmp_path / "dive.mcap", point_cloud(0), point_cloud(1, TABLE * 2))])
    assert [(scan.name, scan.stamp) for scan in read.scans] == [("dive#0", STAMP + 0.25), ("dive#1", STAMP + 1.25)]
    for k, scan in enumerate(read.scans):
        np.testing.assert_array_equal(scan.points, POINTS * (k + 1))
        np.testing.assert_array_equal(scan.strength, STRENGTH * (k + 1))


def test_the_pose_of_a_foxglove_cloud_is_applied(tmp_path: Path) -> None:
    message = point_cloud()
    message.pose.position.x, message.pose.position.z = 3, -0.5
    message.pose.orientation.z = message.pose.orientation.w = np.sqrt(0.5)
    scan = read_scan(write_foxglove(tmp_path / "a.mcap", message))
    x, y, z = POINTS.T
    np.testing.assert_allclose(scan.points, np.column_stack([3 - y, x, z - 0.5]), atol=1e-6)
    np.testing.assert_allclose(np.asarray(scan.viewpoints), np.tile([3, 0, -0.5], (5, 1)), atol=1e-6)


@pytest.mark.parametrize("stride", [0, 2**31])
def test_strides_that_do_not_fit_are_refused(tmp_path: Path, stride: int) -> None:
    message = point_cloud()
    message.point_stride = stride
    words = r"message 0 of /points: it holds 130 bytes, which is no multiple of its point size"
    refuses(words, read_scan, write_foxglove(tmp_path / "a.mcap", message))


def test_chunks_of_an_indexed_mcap_file_are_unpacked_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Of a whole file the chunks of a topic are unpacked, each once; of one that was cut all, again and again."""
    camera: list[Record] = [
        (
            "/camera",
            "std_msgs/msg/Header",
            STAMP + 3 + 0.01 * k,
            {"stamp": {"sec": k, "nanosec": 0}, "frame_id": "x" * 999},
        )
        for k in range(200)
    ]
    path = write_mcap(tmp_path / "dive.mcap", dive("/sonar/points") + camera, chunk_size=4096)
    plain, unpacked = Unpacker.__call__, list[bytes]()

    def counting(self: Unpacker, content: bytes, compression: str) -> bytes:
        unpacked.append(content)
        return plain(self, content, compression)

    monkeypatch.setattr(Unpacker, "__call__", counting)
    whole = read_scans([path])
    assert len(unpacked) == len(set(unpacked)) < 10
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(path.read_bytes()[:-100])
    unpacked.clear()
    assert [scan.stamp for scan in read_scans([cut]).scans] == [scan.stamp for scan in whole.scans]
    assert len(unpacked) > 2 * len(set(unpacked)) - 1 > 50


def test_clouds_as_json_are_refused(tmp_path: Path) -> None:
    with (tmp_path / "a.mcap").open("wb") as file:
        writer = PlainWriter(file)
        writer.start()
        schema = writer.register_schema("foxglove.PointCloud", "jsonschema", b"{}")
        channel = writer.register_channel("/points", "json", schema)
        writer.add_message(channel, 0, b"{}", 0)
        writer.finish()
    refuses(r"its foxglove\.PointCloud is encoded as 'json'; wanted cdr, ros1 or proto", read_scan, tmp_path / "a.mcap")
