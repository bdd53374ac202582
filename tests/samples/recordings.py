"""Recordings of a Sonar 3D-15, written with wlsonar's own codec: whole, and with packets lost, doubled, late."""

import tempfile
import zlib
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from wlsonar import range_image_protocol as rip

from sonarmap.tools.files.readers.clouds.cloud import Cloud
from sonarmap.tools.files.readers.sonar.recording import stream_sonar

START = 1_700_000_000.25  # [s]
RATE = 5.0  # shots per second
WIDTH, HEIGHT = 64, 16
PIXEL, SPEED = 0.00075, 1480.0  # [m], [m/s]


@dataclass(frozen=True, slots=True)
class PacketOf:
    """A packet, and what is in it: "range" or "strength", and the shot's number from 0."""

    kind: str
    shot: int
    content: bytes


@dataclass(slots=True)
class Events:
    """What was done to a recording: packets that were lost, how many were doubled, range images that were exchanged."""

    lost: list[PacketOf] = field(default_factory=list)
    doubled: int = 0
    exchanged: int = 0


def stamp_at(shot: int, rate: float = RATE) -> tuple[int, int]:
    """Stamp of a shot in seconds and nanoseconds, at `rate` shots per second."""
    nanos = round(shot / rate * 1e9)
    return int(START) + (nanos + 250_000_000) // 10**9, (nanos + 250_000_000) % 10**9


def range_image(
    sequence: int, pixels: np.ndarray, scale: float = 0.125, fields: Sequence[float] = (90.0, 40.0), **more: Any
) -> rip.RangeImage:
    """A range image (height, width) of integers, of fields of view [deg], stamped a quarter past."""
    height, width = pixels.shape
    image = rip.RangeImage(
        width=width, height=height, fov_horizontal=fields[0], fov_vertical=fields[1], image_pixel_scale=scale,
        image_pixel_data=pixels.ravel().tolist(), **more,
    )  # fmt: skip
    image.header.sequence_id = sequence
    image.header.timestamp.seconds, image.header.timestamp.nanos = int(START) + sequence, 250_000_000
    return image


def strength_image(sequence: int, levels: np.ndarray) -> rip.BitmapImageGreyscale8:
    """A strength image of levels (height, width), without a time."""
    kind, (height, width) = rip.BitmapImageType.SIGNAL_STRENGTH_IMAGE, levels.shape
    content = levels.astype(np.uint8).tobytes()
    image = rip.BitmapImageGreyscale8(type=kind, width=width, height=height, image_pixel_data=content)
    image.header.sequence_id = sequence
    return image


def packets_of(
    shot: int, number: int, stamp: tuple[int, int], image: rip.RangeImage, strength: rip.BitmapImageGreyscale8
) -> list[PacketOf]:
    """Both images of a shot, numbered and stamped."""
    for message in (image, strength):
        message.header.sequence_id = number % 2**32
        message.header.timestamp.seconds, message.header.timestamp.nanos = stamp
    return [PacketOf("range", shot, rip.packb(image)), PacketOf("strength", shot, rip.packb(strength))]


def shot_packets(shot: int, number: int, rng: np.random.Generator, speed_of_sound: float = SPEED) -> list[PacketOf]:
    """The range and the strength image of one shot, filled with noise."""
    pixels = rng.integers(0, 20_000, (HEIGHT, WIDTH)) * (rng.random((HEIGHT, WIDTH)) < 0.7)
    image = range_image(0, pixels, PIXEL, speed_of_sound=speed_of_sound, range=15.0, frequency=5)
    strength = strength_image(0, rng.integers(0, 256, (HEIGHT, WIDTH), dtype=np.uint8))
    return packets_of(shot, number, stamp_at(shot), image, strength)


def with_checksum(packet: bytes) -> bytes:
    """The packet with a valid checksum."""
    return packet[:-4] + zlib.crc32(packet[:-4]).to_bytes(4, "little")


def recording(shots: int, first: int = 4448, seed: int = 1, after: int = 0) -> Iterator[PacketOf]:
    """Packets of `shots` shots after the first `after` ones; shot k has the number `first` + k."""
    for shot in range(after, after + shots):
        yield from shot_packets(shot, first + shot, np.random.default_rng([seed, shot]))


def disturbed(packets: Sequence[PacketOf], seed: int, share: float = 0.01) -> tuple[list[PacketOf], Events]:
    """A share of the packets lost, as many doubled, and as many exchanged with the next one of their kind."""
    rng = np.random.default_rng(seed)
    events, mixed, exchanged = Events(), list(packets), set[PacketOf]()
    place = 0
    while place + 2 < len(mixed):
        if rng.random() < share:
            pair = mixed[place], mixed[place + 2]
            mixed[place + 2], mixed[place] = pair
            exchanged |= set(pair)
            events.exchanged += pair[0].kind == "range"
            place += 4  # so that each packet is exchanged once
        place += 1
    kept = list[PacketOf]()
    for packet in mixed:
        fate = 1.0 if packet in exchanged else rng.random()
        if fate < share:
            events.lost.append(packet)
            continue
        kept.append(packet)
        if fate < 2 * share:
            kept.append(packet)
            events.doubled += 1
    return kept, events


def damage_a_shot(packets: list[PacketOf], events: Events, after: int) -> set[int]:
    """Damage a range image that is not doubled, of a shot after `after`; returns the shots without a range image."""
    hit = next(k for k, p in enumerate(packets) if p.shot > after and p.kind == "range" and packets.count(p) == 1)
    packets[hit] = replace(packets[hit], content=packets[hit].content[:-1] + b"?")
    return {packet.shot for packet in (*events.lost, packets[hit]) if packet.kind == "range"}


def written(path: Path, packets: Sequence[PacketOf] | Iterator[PacketOf]) -> Path:
    """Write a file with these packets."""
    with path.open("wb") as file:
        for packet in packets:
            file.write(packet.content)
    return path


def read_sonar(content: bytes, notes: list[str] | None = None) -> list[Cloud]:
    """The clouds of a recording with this content."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "dive.sonar"
        path.write_bytes(content)
        return list(stream_sonar(path, [] if notes is None else notes))


def imu_batch(number: int, times: Sequence[float], forces: np.ndarray, rates: np.ndarray) -> rip.ImuBatch:
    """A batch of samples in the file's axes, x forward, y right, z down; times are seconds after START's second."""
    batch = rip.ImuBatch(batch_sequence_id=number, samples=len(times))
    for time in times:
        nanos = round(time * 1e9)
        batch.timestamp.add(seconds=int(START) + nanos // 10**9, nanos=nanos % 10**9)
    batch.specific_force.extend(np.ravel(forces).tolist())
    batch.rate_of_turn.extend(np.ravel(rates).tolist())
    return batch


def imu_packets(
    seconds: float, force_at: Callable[[float], np.ndarray], rate: np.ndarray, hz: int = 100
) -> list[bytes]:
    """Batches of a tenth of a second each, from START's whole second on."""
    packets, each = [], hz // 10
    for number in range(round(10 * seconds)):
        times = [(number * each + k) / hz for k in range(each)]
        batch = imu_batch(number, times, np.array([force_at(t) for t in times]), np.tile(rate, (each, 1)))
        packets.append(rip.packb(batch))
    return packets
