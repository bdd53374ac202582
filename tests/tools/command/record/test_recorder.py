"""Packets on the loopback to a file: what is lost, doubled, late, damaged, foreign or of another sonar, counted."""

import socket
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_array_equal
from wlsonar import range_image_protocol as rip

import sonarmap
from sonarmap.slam.loops.settings import LoopSettings
from sonarmap.slam.mapper import MapperSettings
from sonarmap.tools.command.record.tally import IMU, RANGES, STRENGTHS
from sonarmap.tools.files.readers.sonar.recording import Recording
from tests.samples.dives import Dive
from tests.samples.live.recorded import messages_by_wlsonar, record_while
from tests.samples.live.sender import LOOPBACK, full_size, sender
from tests.samples.recordings import PacketOf, disturbed, imu_packets, recording, with_checksum, written

OTHER = "127.0.0.2"
GROUP = "239.255.47.47"  # of those that no router hands on
AT_ONCE = 20  # datagrams; Linux grants a receive buffer for five times as many, if not told otherwise


def contents(count: int, first: int = 4448) -> list[bytes]:
    """The datagrams of so many shots."""
    return [packet.content for packet in recording(count, first=first)]


def send_all(datagrams: list[bytes], to: tuple[str, int], address: str = LOOPBACK) -> None:
    with sender(address) as sending:
        for number, content in enumerate(datagrams):
            sending.sendto(content, to)
            if number % AT_ONCE == 0:
                time.sleep(0.01)


def lost_between(kind: str, sent: list[PacketOf], lost: list[PacketOf]) -> int:
    """Of a kind, those lost between the first and the last that were sent: nobody misses others."""
    shots = [packet.shot for packet in sent if packet.kind == kind]
    return sum(packet.kind == kind and min(shots) < packet.shot < max(shots) for packet in lost)


def test_losses_are_counted_and_all_else_is_in_the_file(tmp_path: Path) -> None:
    packets, events = disturbed(list(recording(400)), seed=3, share=0.03)
    datagrams = [packet.content for packet in packets]
    status, warnings = record_while(tmp_path / "dive.sonar", lambda to: send_all(datagrams, to))
    assert status.path == tmp_path / "dive.sonar"
    assert status.path.read_bytes() == b"".join(datagrams)
    ranges, strengths = status.tally.kinds[RANGES], status.tally.kinds[STRENGTHS]
    assert ranges.numbers.missing == lost_between("range", packets, events.lost) > 0
    assert strengths.numbers.missing == lost_between("strength", packets, events.lost) > 0
    assert ranges.numbers.late == events.exchanged > 0
    assert ranges.doubled + strengths.doubled == events.doubled > 0
    assert ranges.came == len({packet.shot for packet in packets if packet.kind == "range"})
    assert status.tally.packets == len(packets)
    assert (status.unsaved, status.overflow, status.senders.damaged, status.senders.foreign) == (0, 0, 0, 0)
    assert [path.name for path in tmp_path.iterdir()] == ["dive.sonar"]
    assert not any("busy:" in words or "slow" in words for words in warnings)


def test_the_file_is_read_by_our_reader_and_by_wlsonar(tmp_path: Path) -> None:
    packets = contents(30)
    imu = imu_packets(6.0, lambda _: np.array([0.0, 0.0, -9.81]), np.zeros(3))
    status, _ = record_while(tmp_path / "dive.sonar", lambda to: send_all([*packets, *imu], to))
    assert [type(message) for message in messages_by_wlsonar(status.path)] == [
        *[rip.RangeImage, rip.BitmapImageGreyscale8] * 30,
        *[rip.ImuBatch] * 60,
    ]
    assert status.tally.kinds[IMU].came == 60
    read = Recording()
    assert len(list(read.read(status.path))) == read.shots == status.tally.shots == 30
    assert read.notes() == []


def test_what_is_not_the_sonars_is_counted_and_left_out(tmp_path: Path) -> None:
    packets = contents(20)
    flipped = packets[8][:-1] + bytes([packets[8][-1] ^ 1])
    datagrams = [*packets[:8], flipped, packets[9][:-5], b"noise from the sonar", b"", *packets[10:]]

    def sends(to: tuple[str, int]) -> None:
        send_all(datagrams[:20], to)
        send_all([b"$GPGGA,123519,4807.038,N", b"RIP", bytes(65507)], to, "127.0.0.3")
        send_all(datagrams[20:], to)

    status, _ = record_while(tmp_path / "dive.sonar", sends)
    assert status.path.read_bytes() == b"".join([*packets[:8], *packets[10:]])
    assert (status.senders.damaged, status.senders.foreign) == (4, 3)
    assert status.senders.first_damage == "has a wrong checksum"
    assert "from 127.0.0.3, beginning with '$GPGGA" in status.senders.first_foreign
    assert [kind.numbers.missing for kind in status.tally.kinds.values()] == [1, 1, 0, 0]


def test_packets_of_kinds_that_nobody_knows_are_kept(tmp_path: Path) -> None:
    unknown = rip.packb(rip.Header(sequence_id=7))
    unreadable = with_checksum(rip.packb(rip.RangeImage(width=1)).replace(b"RIP2", b"RIP1"))
    packets = contents(2)
    status, _ = record_while(tmp_path / "a.sonar", lambda to: send_all([packets[0], unknown, unreadable], to))
    assert status.path.read_bytes() == packets[0] + unknown + unreadable
    assert (status.tally.undocumented, status.tally.unreadable, status.tally.packets) == (1, 1, 3)


@pytest.mark.parametrize(("wanted", "kept"), [(None, 0), (OTHER, 1), (LOOPBACK, 0)])
def test_of_two_sonars_one_is_recorded(tmp_path: Path, wanted: str | None, kept: int) -> None:
    both = [contents(15, first) for first in (100, 7000)]

    def sends(to: tuple[str, int]) -> None:
        for pair in zip(*both, strict=True):
            for content, address in zip(pair, (LOOPBACK, OTHER), strict=True):
                send_all([content], to, address)

    status, warnings = record_while(tmp_path / "dive.sonar", sends, sonar=wanted)
    assert status.path.read_bytes() == b"".join(both[kept])
    assert (status.senders.sonar, status.senders.addresses) == ((LOOPBACK, OTHER)[kept], [(LOOPBACK, OTHER)[1 - kept]])
    assert (status.senders.others, status.tally.missing) == (30, 0)
    assert f"another sonar sends too ({(LOOPBACK, OTHER)[1 - kept]})" in " ".join(warnings)


def test_a_sonar_that_comes_back_at_another_address(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("sonarmap.tools.command.record.receiver._GONE", 0.2)
    packets = contents(10)

    def sends(to: tuple[str, int]) -> None:
        send_all(packets[:8], to)
        while (tmp_path / "dive.part.sonar").stat().st_size < sum(map(len, packets[:8])):
            time.sleep(0.01)
        time.sleep(0.5)
        send_all(packets[8:], to, OTHER)

    status, warnings = record_while(tmp_path / "dive.sonar", sends)
    assert status.path.read_bytes() == b"".join(packets)
    assert (status.senders.sonar, status.senders.moves, status.senders.others) == (OTHER, 1, 0)
    assert status.longest_silence > 0.4
    assert "packets now come from 127.0.0.2" in " ".join(warnings)


@pytest.fixture
def interface() -> str:
    """The loopback, where multicast is possible on it."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as hearing, sender() as sending:
        hearing.settimeout(0.5)
        hearing.bind((GROUP, 0))
        try:
            membership = socket.inet_aton(GROUP) + socket.inet_aton(LOOPBACK)
            hearing.setsockopt(socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP, membership)
            sending.sendto(b"?", hearing.getsockname())
            hearing.recv(16)
        except OSError as error:
            pytest.skip(f"no multicast on the loopback here: {error}")
    return next(name for _, name in socket.if_nameindex() if name.startswith("lo"))


@pytest.mark.parametrize("which", ["all", "name", "address"])
def test_multicast(tmp_path: Path, interface: str, which: str) -> None:
    packets = contents(10)
    given = {"all": None, "name": interface, "address": LOOPBACK}[which]
    status, _ = record_while(tmp_path / "dive.sonar", lambda to: send_all(packets, to), GROUP, interface=given)
    assert status.path.read_bytes() == b"".join(packets)


def test_a_group_takes_nothing_that_is_sent_to_an_address(tmp_path: Path, interface: str) -> None:
    packets = contents(10)

    def sends(to: tuple[str, int]) -> None:
        send_all(packets[:10], (LOOPBACK, to[1]))
        send_all(packets[10:], to)

    status, _ = record_while(tmp_path / "dive.sonar", sends, GROUP, interface=interface)
    assert status.path.read_bytes() == b"".join(packets[10:])


def test_images_of_the_full_size_and_the_clock(tmp_path: Path) -> None:
    ahead = 100.0

    def sends(to: tuple[str, int]) -> None:
        with sender() as sending:
            for shot in range(8):
                for content in list(full_size(1, 20.0, shot, time.time() + ahead)):
                    sending.sendto(content, to)

    status, _ = record_while(tmp_path / "dive.sonar", sends)
    assert status.size > 8 * 30_000
    assert status.tally.clock.first == pytest.approx(ahead, abs=8)


def test_the_map_of_the_recording_is_that_of_the_source(tmp_path: Path) -> None:
    dive = Dive("rubble", 8, rate=0.5, columns=64, rows=16)
    source = written(tmp_path / "source.sonar", dive.packets())
    datagrams = [packet.content for packet in dive.packets()]
    status, _ = record_while(tmp_path / "dive.sonar", lambda to: send_all(datagrams, to))
    results = []
    for path in (source, status.path):
        scans = [replace(scan, name=str(k)) for k, scan in enumerate(sonarmap.read_scans(path))]
        results.append(sonarmap.map_scans(scans, edge=64, settings=MapperSettings(LoopSettings(per_scan=0))))
    one, other = results
    assert_array_equal(one.maps[0].points, other.maps[0].points)
    assert len(one.maps[0].points) > 300
    assert one.voxel == other.voxel
