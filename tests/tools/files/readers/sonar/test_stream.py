"""Recordings as they come from the sea: packets lost, doubled, late and damaged, numbers that wrap or start again."""

import re
from pathlib import Path

import numpy as np
import pytest
from wlsonar import range_image_protocol as rip

from sonarmap.tools.files.readers.clouds.cloud import Cloud
from sonarmap.tools.files.readers.sonar.recording import stream_sonar
from tests.samples.cloud_files import sonar_packets
from tests.samples.recordings import (
    PacketOf,
    disturbed,
    range_image,
    read_sonar,
    recording,
    shot_packets,
    strength_image,
    written,
)
from tests.samples.refusals import refuses

pytestmark = pytest.mark.filterwarnings("error")


def content(packets: list[PacketOf]) -> bytes:
    return b"".join(packet.content for packet in packets)


def noted(recorded: bytes) -> tuple[list[Cloud], list[str]]:
    """The clouds of a recording, and the notes on it."""
    notes: list[str] = []
    return read_sonar(recorded, notes), notes


def numbers_in(notes: list[str], words: str) -> list[int]:
    """The numbers of the only note with these words, none if there is no such note."""
    chosen = [note.removeprefix("dive.sonar: ") for note in notes if words in note]
    assert len(chosen) <= 1
    return [int(number.replace(",", "")) for number in re.findall(r"\d[\d,]*", chosen[0])] if chosen else []


def assert_same(cloud: Cloud, clean: Cloud) -> None:
    """To the last bit, but for a strength image that was lost."""
    assert cloud.stamp == clean.stamp
    np.testing.assert_array_equal(cloud.points, clean.points)
    if cloud.strength is not None:
        np.testing.assert_array_equal(cloud.strength, clean.strength)


def damaged(packet: PacketOf) -> PacketOf:
    """With a bit of its pixels turned."""
    changed = bytearray(packet.content)
    changed[len(changed) // 2] ^= 0x10
    return PacketOf(packet.kind, packet.shot, bytes(changed))


@pytest.fixture(scope="module")
def clean() -> list[PacketOf]:
    return list(recording(300, first=2**32 - 100))


@pytest.mark.quick_cases(1)
@pytest.mark.parametrize("seed", range(3))
def test_disturbances_are_counted_and_other_shots_unchanged(tmp_path: Path, clean: list[PacketOf], seed: int) -> None:
    """1 % lost, 1 % doubled, 1 % exchanged, a damaged packet, and a wrap: all counted, and no other shot changed."""
    packets, events = disturbed(clean, seed)
    hit = next(k for k in range(200, 400) if packets[k].kind == "range" and packets[k] not in packets[k + 1 :])
    assert packets[hit] not in packets[:hit]
    packets[hit] = damaged(packets[hit])
    notes: list[str] = []
    clouds = list(stream_sonar(written(tmp_path / "dive.sonar", packets), notes))
    whole, of_whole = noted(content(clean))
    assert not [note for note in of_whole if "wrapped once" not in note]

    lost = {packet.shot for packet in events.lost if packet.kind == "range"} | {packets[hit].shot}
    inner = lost & set(range(1, 299))  # of the first and the last shot nothing tells
    left = sorted(set(range(300)) - lost)
    assert [cloud.stamp for cloud in clouds] == [whole[shot].stamp for shot in left]
    for cloud, shot in zip(clouds, left, strict=True):
        assert_same(cloud, whole[shot])
    bare = {packet.shot for packet in events.lost if packet.kind == "strength"}
    assert {shot for cloud, shot in zip(clouds, left, strict=True) if cloud.strength is None} == bare - lost

    for words, wanted in (
        ("are missing", [len(inner), len(left) + len(inner)]),
        ("damaged", [1, len(packets[hit].content)]),
        ("doubled", [events.doubled]),
        ("came late", [events.exchanged]),
        ("have no strength", [len(bare - lost)]),
        ("without a range image", [len(lost - bare)]),
    ):
        assert numbers_in(notes, words)[: len(wanted)] == (wanted if wanted[0] else []), words
    assert any("wrapped once" in note for note in notes)
    assert not any("again" in note or "clock" in note or "stamps" in note for note in notes)


class TestDamage:
    def test_a_cut_recording_has_all_shots_before_the_cut(self) -> None:
        packets = sonar_packets()
        whole, ends = read_sonar(b"".join(packets)), np.cumsum([len(packet) for packet in packets])
        for kept in sorted({*range(1, ends[-1], 3), *ends.tolist()}):
            complete = int((ends <= kept).sum())
            if complete == 0:
                refuses(r"no range image can be read; packet 1 at byte 0 ", read_sonar, b"".join(packets)[:kept])
                continue
            clouds, notes = noted(b"".join(packets)[:kept])
            assert len(clouds) == (complete + 1) // 2
            for cloud, clean in zip(clouds, whole, strict=False):
                assert_same(cloud, clean)
            over = kept - ends[complete - 1]
            said = f"the recording is cut: of its last packet there are only {over} byte"
            assert any(said in note for note in notes) == (over > 0)
            assert not any("damaged" in note for note in notes)

    def test_a_damaged_byte_costs_only_its_packet(self) -> None:
        packets = sonar_packets()
        whole, starts = read_sonar(b"".join(packets)), np.cumsum([0, *(len(packet) for packet in packets)])
        for place in range(0, starts[-1], 5):
            changed = bytearray(b"".join(packets))
            changed[place] ^= 0x10
            hit = int(np.searchsorted(starts, place, side="right")) - 1
            clouds, notes = noted(bytes(changed))
            left = [shot for shot in range(3) if hit != 2 * shot]
            assert len(clouds) == len(left)
            for cloud, shot in zip(clouds, left, strict=True):
                assert_same(cloud, whole[shot])
                assert (cloud.strength is None) == (hit == 2 * shot + 1)
            said = f"1 damaged packet left out, {len(packets[hit])} bytes: packet {hit + 1} at byte {starts[hit]} "
            cut = hit == 5 and any("the recording is cut" in note for note in notes)  # its length is too large
            assert cut or any(said in note for note in notes), notes

    def test_garbage_between_packets_and_false_beginnings_are_skipped(self) -> None:
        packets = sonar_packets()
        false = b"RIP2\x40\0\0\0 and no packet RIP1RIPRIP2\x0c\0\0\0"
        for place in range(7):
            clouds, (note,) = noted(b"".join([*packets[:place], false, *packets[place:]]))
            assert len(clouds) == 3
            end = f"the recording is cut: of its last packet there are only {len(false)} bytes"
            assert (end if place == 6 else f"1 damaged packet left out, {len(false)} bytes") in note

    def test_damage_longer_than_a_chunk_is_skipped(self, monkeypatch: pytest.MonkeyPatch) -> None:
        from sonarmap.tools.files.readers.sonar import packets as module

        monkeypatch.setattr(module, "_CHUNK", 50)
        monkeypatch.setattr(module, "_SEARCHED", 20)
        garbage = np.random.default_rng(1).bytes(5000)
        packets = sonar_packets()
        assert len(read_sonar(packets[0] + garbage + b"".join(packets[1:]))) == 3


class TestNumbers:
    """Of shots: `first`, and so on."""

    def test_numbers_that_start_again_are_noted(self) -> None:
        rng = np.random.default_rng(2)
        shots = [(shot, 5000 + shot if shot < 40 else shot - 40) for shot in range(80) if shot not in (7, 50, 51)]
        packets = [packet for shot, number in shots for packet in shot_packets(shot, number, rng)]
        clouds, notes = noted(content(packets))
        assert np.all(np.diff([cloud.stamp or 0 for cloud in clouds]) > 0)
        assert numbers_in(notes, "are missing") == [3, 80]
        assert any("start again once" in note for note in notes)
        assert all(cloud.strength is not None for cloud in clouds)
        assert not any("late" in note for note in notes)

    def test_a_shot_that_comes_up_to_sixteen_shots_late_is_in_order(self) -> None:
        clean = list(recording(60))
        for late in (1, 5, 16):
            packets = [*clean[:20], *clean[22 : 22 + 2 * late], *clean[20:22], *clean[22 + 2 * late :]]
            clouds, notes = noted(content(packets))
            assert np.all(np.diff([cloud.stamp or 0 for cloud in clouds]) > 0)
            assert numbers_in(notes, "late")[:1] == [1]
            assert len(notes) == 1

    def test_images_that_wait_for_their_partner_are_bounded(self, tmp_path: Path) -> None:
        """A recording of strength images alone, and of range images after all of theirs."""
        shots = [shot_packets(shot, shot, np.random.default_rng(shot)) for shot in range(200)]
        strengths, ranges = ([packets[kind] for packets in shots] for kind in (1, 0))
        notes: list[str] = []
        refuses("no range image among its 200 packets", read_sonar, content(strengths))
        clouds = read_sonar(content(strengths + ranges), notes)
        assert [cloud.strength is not None for cloud in clouds] == [False] * 168 + [True] * 32
        assert numbers_in(notes, "without a range image") == [168]

    def test_shots_without_numbers_and_times_are_all_read(self) -> None:
        """Only what is the same to the bit is doubled."""
        images = [rip.RangeImage(width=4, height=3, image_pixel_scale=0.125) for _ in range(20)]
        for k, image in enumerate(images):
            image.fov_horizontal, image.fov_vertical = 90.0, 40.0
            image.image_pixel_data.extend([10 + k] * 12)
        clouds, notes = noted(b"".join(rip.packb(image) for image in [*images, images[7]]))
        assert [cloud.points[0, 0] for cloud in clouds] == sorted(cloud.points[0, 0] for cloud in clouds)
        assert len(clouds) == 20
        assert numbers_in(notes, "doubled") == [1]


class TestClock:
    def notes_of(self, stamps: list[float], speeds: list[float] | None = None) -> list[str]:
        packets = []
        for shot, stamp in enumerate(stamps):
            image = range_image(shot, np.arange(12).reshape(3, 4))
            image.header.timestamp.seconds, image.header.timestamp.nanos = int(stamp), round(stamp % 1 * 1e9)
            image.speed_of_sound = speeds[shot] if speeds else 1480.0
            packets.append(rip.packb(image))
        _, notes = noted(b"".join(packets))
        return [note.removeprefix("dive.sonar: ") for note in notes]

    JUMP = "the clock jumps once against the numbers of the shots, by up to 37.0 s: it was set, or the sonar paused"

    @pytest.mark.parametrize(
        ("stamps", "wanted"),
        [
            ([5.25, 5.5, 5.75], ["the clock was not set: it ends at 1970-01-01 00:00:05 UTC"]),
            ([1.7e9] * 5, ["the clock stands still: 4 of 4 stamps are those of the shot before"]),
            ([1.7e9 + k / 4 + 37.0 * (k >= 30) for k in range(60)], [JUMP]),
            (
                [1.7e9 + k / 4 - 37.0 * (k >= 30) for k in range(60)],
                ["1 of 59 stamps are not later than that of the shot before", JUMP],
            ),
            ([4.0e9, 4.0e9 + 0.5], ["the clock is ahead: it ends at 2096-10-02 07:06:40 UTC, and the file was last"]),
        ],
        ids=["never set", "stands still", "goes on", "goes back", "ahead of the file"],
    )
    def test_a_wrong_clock_is_noted(self, stamps: list[float], wanted: list[str]) -> None:
        notes = self.notes_of(stamps)
        assert [note[: len(words)] for note, words in zip(notes, wanted, strict=True)] == wanted

    def test_changes_of_the_sound_speed_are_noted(self) -> None:
        stamps = [1.7e9 + k for k in range(5)]
        assert self.notes_of(stamps, [1480.0, 1480.0, 1497.5, 1497.5, 1482.0]) == [
            "the speed of sound changes 2 times, between 1480.0 and 1497.5 m/s"
        ]


def test_strength_images_without_a_time_are_matched_by_number() -> None:
    levels = np.full((3, 4), 50)
    for order in (1, -1):
        messages = [range_image(3, np.ones((3, 4), int)), strength_image(3, levels)][::order]
        (cloud,) = read_sonar(b"".join(rip.packb(message) for message in messages))
        assert cloud.strength is not None
