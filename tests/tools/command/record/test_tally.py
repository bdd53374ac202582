"""Counts by numbers, the clock's offset, warnings and words, against figures worked by hand."""

from collections.abc import Iterator
from ipaddress import IPv4Address
from pathlib import Path

import numpy as np
import pytest
from wlsonar import range_image_protocol as rip

from sonarmap.tools.command.record.receiver import Datagram, Senders, Source
from sonarmap.tools.command.record.recorder import RANGES, ClockOffset, RecordSettings, Status, Tally
from sonarmap.tools.command.record.words import Watch
from sonarmap.tools.files.readers.sonar.packets import fault_of
from tests.samples.damage.mutations import mutated
from tests.samples.live.sender import LOOPBACK
from tests.samples.processor_time import processor_time
from tests.samples.recordings import recording, with_checksum


def test_the_clock_is_told_by_the_packets_that_took_the_least_time() -> None:
    clock, rng = ClockOffset(), np.random.default_rng(5)
    for k in range(600):  # of 30 s, in which the sonar's clock goes from 2.5 s ahead to 2.8 s
        stamp = 100.0 + k / 20
        clock.add(stamp + 2.5 + 0.01 * k / 20, stamp + 0.040 + rng.exponential(0.050))
    assert clock.first == pytest.approx(2.5 - 0.040 + 0.05, abs=0.06)
    assert clock.latest == pytest.approx(2.5 - 0.040 + 0.15, abs=0.06)


def shot(number: int, stamp: float) -> bytes:
    image = rip.RangeImage(width=1, height=1, image_pixel_data=[5])
    image.header.sequence_id = number
    image.header.timestamp.FromNanoseconds(round(stamp * 1e9))
    return rip.packb(image)


def test_numbers_that_wrap_start_again_and_come_twice() -> None:
    numbers = {2**32 - 3: 0, 2**32 - 2: 1, 1: 4, 0: 3, 4: 7, 90_000: 8, 90_001: 9}  # with their times [s]
    #   missing: 2^32 - 1;  2, 3;  then another count
    tally = Tally()
    for number, time_ in [*numbers.items(), (90_000, 8)]:
        tally.add(shot(number, 2000.0 + time_), 2000.5 + time_)
    ranges = tally.kinds[RANGES]
    assert (ranges.came, ranges.doubled, ranges.numbers.missing, ranges.numbers.restarts) == (7, 1, 3, 1)
    assert (tally.missing, tally.missing_share, tally.packets) == (3, 0.3, 8)


def test_memory_does_not_grow_with_the_numbers() -> None:
    tally = Tally()
    for k in range(3000):
        tally.add(shot(k, 2000 + k / 20), 2000 + k / 20)
    assert len(tally.kinds[RANGES]._seen._keys) == 1024
    senders = Senders(LOOPBACK)
    for k in range(300):
        senders.is_wanted(Datagram(shot(k, 1.0), f"10.0.{k // 256}.{k % 256}", 0.0), 0.0)
    assert (senders.others, len(senders.addresses)) == (300, 8)


def damaged_datagrams(count: int) -> Iterator[tuple[bytes, bytes]]:
    """A packet's datagram damaged at random, and the same with a checksum that fits."""
    whole = [packet.content for packet in recording(4)] + [rip.packb(rip.ImuBatch(samples=3))]
    for number in range(count):
        rng = np.random.default_rng([7, number])
        datagram = mutated(whole[number % len(whole)], whole[(number + 3) % len(whole)], rng)[:65507]
        length = len(datagram).to_bytes(4, "little")
        yield datagram, with_checksum(b"RIP2" + length + datagram[8:]) if len(datagram) >= 12 else datagram


@pytest.mark.parametrize("count", [200, pytest.param(3000, marks=pytest.mark.slow)])
def test_damaged_datagrams_are_counted_and_end_nothing(count: int) -> None:
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


def test_each_warning_comes_once_and_silence_each_time(status: Status) -> None:
    watch, warned = Watch(), []
    for silence in (0.05, 5.5, 9.5, 0.0, 5.1):
        status.silence = silence
        warned.append(list(watch.warnings(status)))
    assert [len(words) for words in warned] == [0, 1, 0, 0, 1]
    assert warned[1][0].startswith("nothing has come for 6 s. Look at the sonar's power")


@pytest.mark.parametrize(
    ("disk", "duration", "said"),
    [
        (1.1e6 * 700, None, []),
        (1.1e6 * 500, None, ["full in 8 min (524 MiB left)"]),
        (1.1e6 * 500, 600.0, ["full in 8 min (524 MiB left), and the recording is to go on for 9 min"]),
        (1.1e6 * 500, 500.0, []),
        (1.1e6 * 50, None, ["full in 50 s", "make room now"]),
        (1.1e6 * 50, 90.0, []),
    ],
)
def test_a_disk_that_will_be_full(status: Status, disk: float, duration: float | None, said: list[str]) -> None:
    source = Source(IPv4Address("224.0.0.96"), 4747)
    status.settings = RecordSettings(source, Path("dive.sonar"), duration)
    status.disk = round(disk)
    warnings = list(Watch().warnings(status))
    assert len(warnings) == len(said)
    assert all(words in warning for words, warning in zip(said, warnings, strict=True))


def test_a_clock_that_is_off_losses_and_a_small_buffer_are_told(status: Status) -> None:
    status.tally.clock.latest, status.buffer, status.overflow, status.unsaved = -7.25, 425_984, 2, 1
    small, busy, slow, clock = Watch().warnings(status)
    wanted = {"holds 416 KiB only": small, "net.core.rmem_max": small, "too busy": busy, "too slow": slow}
    assert all(words in warning for words, warning in wanted.items())
    assert clock.startswith("the sonar's clock is 7.25 s behind this computer's")
    assert "--nav-offset=-7.25" in clock
