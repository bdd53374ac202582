"""A Sonar 3D-15 on the loopback: sends datagrams at a given rate."""

import socket
import time
from collections.abc import Iterable

import numpy as np

LOOPBACK = "127.0.0.1"


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
