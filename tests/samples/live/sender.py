"""A Sonar 3D-15 on the loopback: sends datagrams at a given rate, and makes images of full size."""

import hashlib
import json
import socket
import sys
import time
from collections.abc import Iterable, Iterator, Sequence

import numpy as np
from wlsonar import range_image_protocol as rip

from tests.samples.recordings import PIXEL, SPEED, imu_batch, range_image, strength_image

LOOPBACK = "127.0.0.1"
WIDTH, HEIGHT = 256, 64  # the sonar's, in both of its modes


def free_port() -> int:
    """A UDP port that nobody listens at."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind((LOOPBACK, 0))
        return probe.getsockname()[1]


def sender(address: str = LOOPBACK) -> socket.socket:
    """A socket that sends from this address, multicast over the loopback alone."""
    sending = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    sending.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_IF, socket.inet_aton(LOOPBACK))
    sending.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_TTL, 0)
    sending.bind((address, 0))
    return sending


def send(datagrams: Iterable[bytes], to: tuple[str, int], rate: float = np.inf, address: str = LOOPBACK) -> None:
    """Send datagrams at `rate` [1/s], or all at once."""
    start = time.monotonic()
    with sender(address) as sending:
        for number, content in enumerate(datagrams):
            time.sleep(max(0.0, start + number / rate - time.monotonic()))
            sending.sendto(content, to)


def full_size(shots: int, rate: float, seed: int, start: float) -> Iterator[bytes]:
    """Packets as large as the sonar's: both images of each shot, and an IMU batch with every second one, stamped at
    `rate` [shots/s] from `start` [s, UTC] on."""
    images = [_images(np.random.default_rng([seed, k])) for k in range(8)]
    for shot in range(shots):
        stamp = start + shot / rate
        for message in images[shot % len(images)]:
            message.header.sequence_id = shot
            message.header.timestamp.FromNanoseconds(round(stamp * 1e9))
            yield rip.packb(message)
        if shot % 2 == 0:
            still = np.tile([0.0, 0.0, -9.81], (10, 1))
            times = (shot / rate + np.arange(10) / (5 * rate)).tolist()
            yield rip.packb(imu_batch(shot // 2, times, still, np.zeros((10, 3)), int(start)))


def _images(rng: np.random.Generator) -> Sequence[rip.RangeImage | rip.BitmapImageGreyscale8]:
    """A bed that rises to a side, with noise: about as many bytes as a real image packs to."""
    bed = 6000 + 20 * np.arange(WIDTH) + 40 * np.arange(HEIGHT)[:, None] + rng.integers(0, 64, (HEIGHT, WIDTH))
    image = range_image(0, bed, PIXEL, (40.0, 40.0), speed_of_sound=SPEED, range=15.0, frequency=2_400_000)
    return image, strength_image(0, rng.integers(60, 200, (HEIGHT, WIDTH), dtype=np.uint8))


def send_with_losses(shots: int, port: int, times: float, share: float) -> dict[str, object]:
    """Send a recording of 20 Hz at `times` its rate, without a `share` of its packets.

    Returns:
        How many were sent ("packets"), the SHA-256 of all of them, and how many of each kind were left out between the
        first and the last that were sent ("range", "strength", "imu").
    """
    rng, digest = np.random.default_rng(18), hashlib.sha256()
    sent, lost = (dict[str, list[int]](range=[], strength=[], imu=[]) for _ in range(2))

    def kept() -> Iterator[bytes]:
        for number, content in enumerate(full_size(shots, 20.0, 1, time.time())):
            kind = ("range", "strength", "imu", "range", "strength")[number % 5]
            is_lost = rng.random() < share
            (lost if is_lost else sent)[kind].append(number)
            if not is_lost:
                digest.update(content)
                yield content

    send(kept(), (LOOPBACK, port), 50.0 * times)
    between = {kind: sum(sent[kind][0] < n < sent[kind][-1] for n in lost[kind]) for kind in lost}
    return {"packets": sum(map(len, sent.values())), "sha256": digest.hexdigest(), **between}


if __name__ == "__main__":
    print(json.dumps(send_with_losses(*(json.loads(argument) for argument in sys.argv[1:]))))
