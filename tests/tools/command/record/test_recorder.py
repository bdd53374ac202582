"""Recording packets from the network: lost, late, damaged and foreign packets and other sonars are counted."""

import socket
import time
from collections.abc import Iterator
from ipaddress import IPv4Address
from pathlib import Path

import numpy as np
import pytest
import wlsonar
from wlsonar import range_image_protocol as rip

from sonarmap.kernels.errors import InputError
from sonarmap.tools.command.record.receiver import GROUP as DEFAULT_GROUP
from sonarmap.tools.command.record.receiver import (
    Datagram,
    Senders,
    Source,
    open_socket,
    overflow_of,
    source_of,
    system_buffer,
)
from sonarmap.tools.command.record.recorder import RANGES, STRENGTHS, ClockOffset, RecordSettings, Status, Tally
from sonarmap.tools.command.record.words import Watch
from sonarmap.tools.files.readers.sonar.packets import fault_of
from tests.samples.clutter_scans import refused, sonarmap
from tests.samples.damage.mutations import mutated
from tests.samples.live.recorded import record_while
from tests.samples.live.sender import LOOPBACK, free_port, sender
from tests.samples.processor_time import processor_time
from tests.samples.recordings import PacketOf, disturbed, recording, with_checksum

OTHER = "127.0.0.2"
GROUP = "239.255.47.47"  # a group that no router forwards
AT_ONCE = 20  # datagrams; the default receive buffer of Linux holds five times as many


def contents(count: int, first: int = 4448) -> list[bytes]:
    """Datagrams of `count` shots."""
    return [packet.content for packet in recording(count, first=first)]


def send_all(datagrams: list[bytes], to: tuple[str, int], address: str = LOOPBACK) -> None:
    with sender(address) as sending:
        for number, content in enumerate(datagrams):
            sending.sendto(content, to)
            if number % AT_ONCE == 0:
                time.sleep(0.01)


def lost_between(kind: str, sent: list[PacketOf], lost: list[PacketOf]) -> int:
    """Number of lost packets between the first and last sent one of a kind; other losses go unnoticed."""
    shots = [packet.shot for packet in sent if packet.kind == kind]
    return sum(packet.kind == kind and min(shots) < packet.shot < max(shots) for packet in lost)


def test_losses_are_counted_and_all_received_packets_are_in_the_file(tmp_path: Path) -> None:
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


def test_damaged_and_foreign_packets_are_counted_and_left_out(tmp_path: Path) -> None:
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


def test_packets_of_unknown_kinds_are_kept(tmp_path: Path) -> None:
    unknown = rip.packb(rip.Header(sequence_id=7))
    unreadable = with_checksum(rip.packb(rip.RangeImage(width=1)).replace(b"RIP2", b"RIP1"))
    packets = contents(2)
    status, _ = record_while(tmp_path / "a.sonar", lambda to: send_all([packets[0], unknown, unreadable], to))
    assert status.path.read_bytes() == packets[0] + unknown + unreadable
    assert (status.tally.undocumented, status.tally.unreadable, status.tally.packets) == (1, 1, 3)


@pytest.mark.quick_cases(1)
@pytest.mark.parametrize(("wanted", "kept"), [(None, 0), (OTHER, 1), (LOOPBACK, 0)])
def test_only_one_of_two_sonars_is_recorded(tmp_path: Path, wanted: str | None, kept: int) -> None:
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


def test_a_sonar_that_returns_at_another_address_is_recorded(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
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
    assert "packets now come from 127.0.0.2" in " ".join(warnings)


@pytest.fixture
def interface() -> str:
    """Name of the loopback interface; skips the test if it has no multicast."""
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
def test_multicast_is_recorded(tmp_path: Path, interface: str, which: str) -> None:
    packets = contents(10)
    given = {"all": None, "name": interface, "address": LOOPBACK}[which]
    status, _ = record_while(tmp_path / "dive.sonar", lambda to: send_all(packets, to), GROUP, interface=given)
    assert status.path.read_bytes() == b"".join(packets)


def test_a_multicast_recording_ignores_unicast_packets(tmp_path: Path, interface: str) -> None:
    packets = contents(10)

    def sends(to: tuple[str, int]) -> None:
        send_all(packets[:10], (LOOPBACK, to[1]))
        send_all(packets[10:], to)

    status, _ = record_while(tmp_path / "dive.sonar", sends, GROUP, interface=interface)
    assert status.path.read_bytes() == b"".join(packets[10:])


def test_the_sonars_own_group_is_the_default() -> None:
    assert f"{wlsonar.DEFAULT_MCAST_GRP}:{wlsonar.DEFAULT_MCAST_PORT}" == DEFAULT_GROUP
    assert source_of(None, None, None) == Source(IPv4Address("224.0.0.96"), 4747)
    assert source_of("239.1.2.3:5000", None, "eth7").words == "239.1.2.3:5000 on eth7"
    assert source_of(None, "10.1.2.3:5000", None).words == "10.1.2.3:5000"


@pytest.mark.parametrize(
    ("options", "wanted"),
    [
        (["--multicast", "sonar:4747"], "wanted an IPv4 address"),
        (["--multicast", "224.0.0.96:65536"], "a port from 1 to 65535"),
        (["--multicast", "192.168.194.96:4747"], "for another give --unicast"),
        (["--unicast", "224.0.0.96:4747"], "give --multicast 224.0.0.96:4747"),
        (["--unicast", "0.0.0.0:4747", "--interface", "eth0"], "--interface has no effect with --unicast"),
        (["--interface", "nosuch0"], "The interfaces of this computer are lo"),
        (["--sonar", "sonar"], "--sonar 192.168.194.96"),
        (["--duration", "-5"], "--duration 90, 10m or 1.5h"),
    ],
)
def test_invalid_options_are_refused(tmp_path: Path, options: list[str], wanted: str) -> None:
    result = sonarmap("record", "-o", tmp_path / "a.sonar", *options)
    refused(result, wanted)
    assert result.stderr.startswith("error: ")
    assert list(tmp_path.iterdir()) == []


def test_an_existing_file_is_kept(tmp_path: Path) -> None:
    out = tmp_path / "dive.sonar"
    out.write_bytes(b"older")
    command = ("record", "-o", out, "--unicast", f"{LOOPBACK}:{free_port()}", "--duration", "0.1")
    refused(sonarmap(*command), "--overwrite")
    assert sonarmap(*command, "--overwrite").exit_code == 3  # nothing came, and nothing is replaced
    assert [(path.name, path.read_bytes()) for path in tmp_path.iterdir()] == [("dive.sonar", b"older")]


@pytest.mark.parametrize(("name", "wanted"), [("dive.bag", "does not end in .sonar"), ("folder.sonar", "a folder of")])
def test_an_invalid_output_name_is_refused(tmp_path: Path, name: str, wanted: str) -> None:
    (tmp_path / "folder.sonar").mkdir()
    place = f"{LOOPBACK}:{free_port()}"
    refused(sonarmap("record", "-o", tmp_path / name, "--unicast", place, "--overwrite"), wanted)


def test_a_port_in_use_is_refused(tmp_path: Path) -> None:
    source = Source(IPv4Address(LOOPBACK), free_port())
    with open_socket(source) as listening:
        assert listening.getsockname() == (LOOPBACK, source.port)
        assert system_buffer(listening) > 65_507
        with pytest.raises(InputError, match="Another program listens there"):
            open_socket(source)


@pytest.mark.skipif(not hasattr(socket, "SO_REUSEPORT") or not Path("/proc").exists(), reason="Linux counts these")
def test_packets_lost_by_the_system_are_counted() -> None:
    source = Source(IPv4Address(LOOPBACK), free_port())
    with open_socket(source) as listening, socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sending:
        listening.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        for _ in range(50):
            sending.sendto(bytes(1000), (LOOPBACK, source.port))
        listening.setblocking(False)
        came = 0
        while True:
            try:
                listening.recvmsg(2000, socket.CMSG_SPACE(4))
                came += 1
            except BlockingIOError:
                break
        sending.sendto(b"last", (LOOPBACK, source.port))
        assert overflow_of(listening.recvmsg(2000, socket.CMSG_SPACE(4))[1]) == 50 - came > 0


def test_the_clock_offset_comes_from_the_fastest_packets() -> None:
    clock, rng = ClockOffset(), np.random.default_rng(5)
    for k in range(600):  # 30 s, while the sonar's clock drifts from 2.5 s to 2.8 s ahead
        stamp = 100.0 + k / 20
        clock.add(stamp + 2.5 + 0.01 * k / 20, stamp + 0.040 + rng.exponential(0.050))
    assert clock.latest == pytest.approx(2.5 - 0.040 + 0.15, abs=0.06)


def shot(number: int, stamp: float) -> bytes:
    image = rip.RangeImage(width=1, height=1, image_pixel_data=[5])
    image.header.sequence_id = number
    image.header.timestamp.FromNanoseconds(round(stamp * 1e9))
    return rip.packb(image)


def test_wrapped_restarted_and_repeated_numbers_are_counted() -> None:
    numbers = {2**32 - 3: 0, 2**32 - 2: 1, 1: 4, 0: 3, 4: 7, 90_000: 8, 90_001: 9}  # with their times [s]
    #   missing: 2^32 - 1;  2, 3;  then another count
    tally = Tally()
    for number, time_ in [*numbers.items(), (90_000, 8)]:
        tally.add(shot(number, 2000.0 + time_), 2000.5 + time_)
    ranges = tally.kinds[RANGES]
    assert (ranges.came, ranges.doubled, ranges.numbers.missing, ranges.numbers.restarts) == (7, 1, 3, 1)
    assert (tally.missing, tally.missing_share, tally.packets) == (3, 0.3, 8)


def test_memory_does_not_grow_with_the_number_of_packets() -> None:
    tally = Tally()
    for k in range(3000):
        tally.add(shot(k, 2000 + k / 20), 2000 + k / 20)
    assert len(tally.kinds[RANGES]._seen._keys) == 1024
    senders = Senders(LOOPBACK)
    for k in range(300):
        senders.is_wanted(Datagram(shot(k, 1.0), f"10.0.{k // 256}.{k % 256}", 0.0), 0.0)
    assert (senders.others, len(senders.addresses)) == (300, 8)


def damaged_datagrams(count: int) -> Iterator[tuple[bytes, bytes]]:
    """Datagrams damaged at random, each also with a valid checksum."""
    whole = [packet.content for packet in recording(4)] + [rip.packb(rip.ImuBatch(samples=3))]
    for number in range(count):
        rng = np.random.default_rng([7, number])
        datagram = mutated(whole[number % len(whole)], whole[(number + 3) % len(whole)], rng)[:65507]
        length = len(datagram).to_bytes(4, "little")
        yield datagram, with_checksum(b"RIP2" + length + datagram[8:]) if len(datagram) >= 12 else datagram


@pytest.mark.parametrize("count", [200, pytest.param(3000, marks=pytest.mark.slow)])
def test_damaged_datagrams_are_counted_without_an_error(count: int) -> None:
    tally, senders, kept, start = Tally(), Senders(), 0, processor_time()
    for datagrams in damaged_datagrams(count):
        for content in datagrams:
            if senders.is_wanted(Datagram(content, LOOPBACK, 2000.0), 0.0):
                assert fault_of(content) == ""
                tally.add(content, 2000.0)
                kept += 1
    assert kept == tally.packets
    assert kept + senders.damaged + senders.foreign == 2 * count
    assert tally.unreadable > 0
    assert tally.missing_share <= 1
    assert processor_time() - start < count / 50


@pytest.fixture
def status() -> Status:
    """A minute of recording at 20 Hz."""
    source = Source(IPv4Address("224.0.0.96"), 4747)
    status = Status(RecordSettings(source, Path("dive.sonar")), Path("dive.part.sonar"), 8 << 20)
    status.senders.sonar, status.seconds, status.silence = "10.0.0.9", 60.0, 0.05
    status.disk, status.byte_rate = 2 * 10**12, 1.1e6
    status.shot_rate, status.packet_rate, status.size = 20.0, 50.0, 66_000_000
    for k in range(20):
        if k != 7:
            status.tally.add(shot(k, 2000 + k / 20), 2000 + k / 20 + 0.25)
    return status


def test_each_silence_is_warned_of_once(status: Status) -> None:
    watch, warned = Watch(), []
    for silence in (0.05, 5.5, 9.5, 0.0, 5.1):
        status.silence = silence
        warned.append(list(watch.warnings(status)))
    assert [len(words) for words in warned] == [0, 1, 0, 0, 1]
    assert warned[1][0].startswith("nothing has come for 6 s. Look at the sonar's power")


@pytest.mark.parametrize(
    ("disk", "duration", "expected"),
    [
        (1.1e6 * 700, None, []),
        (1.1e6 * 500, 600.0, ["full in 8 min (524 MiB left), and the recording is to go on for 9 min"]),
        (1.1e6 * 500, 500.0, []),
        (1.1e6 * 50, None, ["full in 50 s", "make room now"]),
    ],
)
def test_warning_of_a_full_disk(status: Status, disk: float, duration: float | None, expected: list[str]) -> None:
    source = Source(IPv4Address("224.0.0.96"), 4747)
    status.settings = RecordSettings(source, Path("dive.sonar"), duration)
    status.disk = round(disk)
    warnings = list(Watch().warnings(status))
    assert len(warnings) == len(expected)
    assert all(words in warning for words, warning in zip(expected, warnings, strict=True))


def test_clock_offset_losses_and_a_small_buffer_are_warned_of(status: Status) -> None:
    status.tally.clock.latest, status.buffer, status.overflow, status.unsaved = -7.25, 425_984, 2, 1
    small, busy, slow, clock = Watch().warnings(status)
    wanted = {"holds 416 KiB only": small, "net.core.rmem_max": small, "too busy": busy, "too slow": slow}
    assert all(words in warning for words, warning in wanted.items())
    assert clock.startswith("the sonar's clock is 7.25 s behind this computer's")
    assert "--nav-offset=-7.25" in clock
