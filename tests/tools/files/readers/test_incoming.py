"""Scans of files and folders that grow, of which a test writes the next piece whenever it is asked whether they have
ended; and of finished files, by a clock that only sleeping moves."""

from collections.abc import Callable, Sequence
from itertools import pairwise
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from sonarmap.spectral.scan import Scan
from sonarmap.tools.files.readers import incoming as module
from sonarmap.tools.files.readers.incoming import Incoming, Mark, final_path, incoming, replayed
from sonarmap.tools.files.readers.scans import AS_RECORDED, read_survey
from tests.samples.bags.messages import CLOUD, STAMP, cloud
from tests.samples.bags.writers import write_mcap
from tests.samples.cloud_files import TABLE, put
from tests.samples.clutter_scans import scan, write
from tests.samples.recordings import PacketOf, recording, written

BEGINNING = Mark()
IDLE = 4  # times that a writer pauses, after which whoever follows has seen all


@pytest.fixture(autouse=True)
def clock(monkeypatch: pytest.MonkeyPatch) -> SimpleNamespace:
    """Seconds, which sleeping moves and nothing else."""

    def sleep(seconds: float) -> None:
        clock.now += seconds
        clock.slept += 1

    clock = SimpleNamespace(now=100.0, slept=0, monotonic=lambda: clock.now, sleep=sleep)
    monkeypatch.setattr(module, "time", clock)
    return clock


def nothing() -> None:
    """A step."""


def followed(source: Path, *steps: Callable[[], object], after: Mark = BEGINNING) -> list[Incoming]:
    """What comes of a source while these steps are done, some time after each other."""
    left = [step for each in (nothing, *steps) for step in (each, *[nothing] * IDLE)]

    def ended() -> bool:
        if left:
            left.pop(0)()
        return not left

    return list(incoming(source, AS_RECORDED, ended, after))


def content(packets: Sequence[PacketOf]) -> bytes:
    return b"".join(packet.content for packet in packets)


def appending(path: Path, piece: bytes) -> Callable[[], object]:
    def append() -> None:
        with path.open("ab") as file:
            file.write(piece)

    return append


def require_same(came: Sequence[Incoming], scans: Sequence[Scan]) -> None:
    assert [each.scan.stamp for each in came] == [each.stamp for each in scans]
    for each, expected in zip(came, scans, strict=True):
        np.testing.assert_array_equal(each.scan.points, expected.points)


def test_a_growing_recording_gives_each_scan_once_and_continues_from_every_mark(tmp_path: Path) -> None:
    packets, path = list(recording(5)), put(tmp_path / "dive.sonar", b"")
    whole = content(packets)
    cuts = [0, 3, len(packets[0].content), 2000, 2001, len(whole) - 7, len(whole)]
    pieces = [whole[begin:end] for begin, end in pairwise(cuts)]
    came = followed(path, *[appending(path, piece) for piece in pieces])
    scans = read_survey([path]).scans
    require_same(came, scans)
    assert [each.scan.name for each in came] == [f"dive#{k}" for k in range(5)]
    for k, each in enumerate(came, 1):
        require_same(followed(path, after=each.behind), scans[k:])


def test_a_recording_that_is_given_its_name_has_ended(tmp_path: Path) -> None:
    path = written(tmp_path / "dive.part.sonar", list(recording(3)))
    came = incoming(path, AS_RECORDED, lambda: bool(path.exists() and path.rename(tmp_path / "dive.sonar")) and False)
    assert len(list(came)) == 3
    assert final_path(path) == tmp_path / "dive.sonar"
    assert final_path(tmp_path / "dive.sonar") == tmp_path / "dive.sonar"


def test_late_and_doubled_shots_are_left_out_and_missing_ones_counted(tmp_path: Path) -> None:
    shots = [list(recording(1, after=k)) for k in range(6)]
    order = (0, 1, 3, 2, 3, 5)
    path = written(tmp_path / "dive.sonar", [packet for k in order for packet in shots[k]])
    came = followed(path)
    require_same(came, [read_survey([path]).scans[k] for k in (0, 1, 3, 4)])  # 2 is there in its order
    assert [each.missing for each in came] == [0, 0, 1, 1]


def test_a_clock_that_is_set_back_leaves_nothing_out(tmp_path: Path) -> None:
    packets = [*recording(3, first=50, after=1000), *recording(2, first=1050, after=3)]
    came = followed(written(tmp_path / "dive.sonar", packets))
    assert len(came) == 5
    assert came[3].scan.stamp < came[2].scan.stamp


def test_a_part_that_is_given_its_name_is_not_read_twice(tmp_path: Path) -> None:
    part, first = tmp_path / "001.part.sonar", content(list(recording(3)))
    second = list(recording(2, after=7))
    came = followed(
        tmp_path,
        appending(part, first[:-9]),
        appending(part, first[-9:]),
        lambda: part.rename(tmp_path / "001.sonar"),
        lambda: written(tmp_path / "002.part.sonar", second),
        lambda: (tmp_path / "002.part.sonar").rename(tmp_path / "002.sonar"),
    )
    require_same(came, read_survey([tmp_path]).scans)
    assert [each.behind.file for each in came] == ["001.sonar"] * 3 + ["002.sonar"] * 2
    for k, each in enumerate(came, 1):
        assert len(followed(tmp_path, after=each.behind)) == 5 - k


def test_after_a_recording_that_is_cut_the_next_one_is_read_and_what_is_missing_is_of_both(tmp_path: Path) -> None:
    cut = content([packet for packet in recording(4) if packet.shot != 1])[:-1300]  # within the last range image
    following = [packet for packet in recording(4, first=900) if packet.shot not in (1, 2)]
    came = followed(
        tmp_path,
        appending(tmp_path / "001.part.sonar", cut),
        appending(tmp_path / "002.part.sonar", content(following)),
    )
    assert [each.behind.file for each in came] == ["001.sonar"] * 2 + ["002.sonar"] * 2
    assert [each.missing for each in came] == [0, 1, 1, 3]


def test_of_a_folder_that_grows_files_are_taken_when_they_are_whole(tmp_path: Path) -> None:
    """Even one whose writer pauses for longer than files are looked at; and one that never is whole is passed."""
    made = tmp_path / "made"
    made.mkdir()
    paths = [Path(name) for name in write(made, **{f"scan_{k}": scan(k) for k in (0, 1, 3)})]
    half = paths[1].read_bytes()
    seen, cut = tmp_path / "seen", 20_000
    seen.mkdir()
    came = followed(
        seen,
        lambda: put(seen / "scan_0.ply", paths[0].read_bytes()),
        appending(seen / "scan_1.ply", half[:cut]),
        appending(seen / "scan_1.ply", half[cut:]),
        appending(seen / "scan_2.ply", half[:cut]),
        lambda: put(seen / "scan_3.ply", paths[2].read_bytes()),
    )
    assert [each.scan.name for each in came] == ["scan_0", "scan_1", "scan_3"]
    assert [each.scan.stamp for each in came] == [0.0, 1.0, 2.0]  # counted, as the files have no times
    for each, expected in zip(came, read_survey(paths).scans, strict=True):
        np.testing.assert_array_equal(each.scan.points, expected.points)
    assert [each.scan.name for each in followed(seen, after=came[1].behind)] == ["scan_3"]


def test_files_that_are_there_already_come_at_once_and_removed_ones_change_nothing(
    tmp_path: Path, clock: SimpleNamespace
) -> None:
    write(tmp_path, **{f"scan_{k}": scan(k % 4)[: 300 + k] for k in range(12)})
    taken = incoming(tmp_path, AS_RECORDED, lambda: clock.slept > 9)
    assert [next(taken).scan.name for _ in range(11)] == [f"scan_{k}" for k in range(11)]
    assert clock.slept == 1
    for k in range(11):
        (tmp_path / f"scan_{k}.ply").unlink()
    assert [each.scan.name for each in taken] == ["scan_11"]


def test_a_replay_keeps_the_pace_of_the_stamps_or_none(tmp_path: Path, clock: SimpleNamespace) -> None:
    path = written(tmp_path / "dive.sonar", [packet for packet in recording(9) if packet.shot not in (2, 3, 4)])
    due = np.array([0, 1, 5, 6, 7, 8]) / 5  # s, at 5 shots per second
    for factor, after in ((10.0, 0), (0.5, 2), (0.0, 0)):
        begun = clock.now
        came = [
            (clock.now - begun, each)
            for each in replayed([str(path)], AS_RECORDED, factor, lambda: False, Mark("", after))
        ]
        expected = (due - due[after])[after:] / factor if factor else np.zeros(6)
        np.testing.assert_allclose([at for at, _ in came], expected, atol=1e-6)
        assert [each.behind.count for _, each in came] == list(range(after + 1, 7))


def test_a_second_recording_of_one_name_is_one_of_its_own(tmp_path: Path) -> None:
    """The first one was cut by a crash; the second one gets the name of both when it ends."""
    written(tmp_path / "dive.part.sonar", list(recording(3)))
    second = tmp_path / "dive.part2.sonar"
    came = followed(
        tmp_path, lambda: written(second, list(recording(2, after=9))), lambda: second.rename(tmp_path / "dive.sonar")
    )
    require_same(came, read_survey([tmp_path]).scans)
    assert len(came) == 5


class TestMcap:
    """Twelve clouds in an MCAP file that comes piece by piece, cut anywhere."""

    @pytest.fixture
    def whole(self, tmp_path: Path) -> bytes:
        records = [("/p", CLOUD, STAMP + k / 4, cloud(TABLE * np.float32(k + 1), STAMP + k / 4)) for k in range(12)]
        path = tmp_path / "whole.mcap"
        write_mcap(path, records, chunk_size=1000)
        return path.read_bytes()

    def test_a_growing_file_gives_each_scan_once_from_every_mark(self, tmp_path: Path, whole: bytes) -> None:
        path, pieces = tmp_path / "grows.mcap", np.linspace(0, len(whole), 8).astype(int)

        def again(after: Mark) -> list[Incoming]:
            path.write_bytes(b"")
            steps = [appending(path, whole[a:b]) for a, b in pairwise(pieces.tolist())]
            return followed(path, *steps, after=after)

        came = again(BEGINNING)
        assert [each.scan.name for each in came] == [f"grows#{k}" for k in range(12)]
        require_same(came, read_survey([path]).scans)
        for k, each in enumerate(came):
            assert [after.scan.name for after in again(each.behind)] == [f"grows#{n}" for n in range(k + 1, 12)]

    def test_a_growing_file_of_a_bag_is_read_to_its_end(self, tmp_path: Path, whole: bytes) -> None:
        folder = tmp_path / "bag"
        folder.mkdir()
        path, half = folder / "bag_0.mcap", len(whole) // 2
        path.write_bytes(whole[:half])

        def end() -> None:
            (folder / "metadata.yaml").write_text("rosbag2_bagfile_information:\n  version: 9\n")

        came = followed(folder, appending(path, whole[half:]), end)
        assert [each.scan.name for each in came] == [f"bag_0#{k}" for k in range(12)]


def test_scans_written_before_the_end_are_read(tmp_path: Path) -> None:
    path = put(tmp_path / "dive.sonar", b"")

    def write_and_end() -> bool:
        written(path, list(recording(3)))
        return True

    assert len(list(incoming(path, AS_RECORDED, write_and_end))) == 3


def test_a_part_that_is_given_its_name_before_it_is_opened_is_read(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    part, size = written(tmp_path / "001.part.sonar", list(recording(3))), module._size

    def renames(path: Path) -> object:
        if part.exists():
            part.rename(tmp_path / "001.sonar")
        return size(path)

    monkeypatch.setattr(module, "_size", renames)
    assert len(followed(tmp_path)) == 3


def test_a_replay_ends_when_it_is_asked_to(tmp_path: Path, clock: SimpleNamespace) -> None:
    path, begun = written(tmp_path / "dive.sonar", list(recording(9))), clock.now
    came = list(replayed([str(path)], AS_RECORDED, 1.0, lambda: clock.now > begun + 0.5))
    assert len(came) == 3


def test_reading_continues_within_a_file_of_several_scans(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    scans = [Scan(scan(k)[:60], stamp=float(k)) for k in range(4)]
    monkeypatch.setattr(module, "_read", lambda *_: scans)
    put(tmp_path / "dive.ply", b"7")
    came = followed(tmp_path)
    require_same(came, scans)
    require_same(followed(tmp_path, after=came[1].behind), scans[2:])
