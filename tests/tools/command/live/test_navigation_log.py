"""NMEA sentences that come by UDP and by a serial line: whole ones are kept, whatever else comes."""

import os
import socket
import time
import tty
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from sonarmap.kernels.errors import InputError
from sonarmap.tools.command.live.navigation_log import NAME, kept_navigation, sentences_in
from sonarmap.tools.files.readers.navigation.nmea import read_nmea
from sonarmap.tools.files.readers.navigation.settings import NavigationSettings
from tests.samples.live.sender import LOOPBACK, free_port, send

FIX = b"$GPGGA,093001.00,6023.478,N,00519.326,E,1,09,0.9,-3.2,M,45.1,M,,*"
HEADING = b"$HEHDT,123.4,T*"


def sentence(body: bytes) -> bytes:
    checksum = 0
    for byte in body[1:-1]:
        checksum ^= byte
    return body + f"{checksum:02X}\r\n".encode()


GOOD = [sentence(FIX), sentence(HEADING)]


def until(condition: Callable[[], bool]) -> None:
    end = time.monotonic() + 10
    while not condition() and time.monotonic() < end:
        time.sleep(0.02)


def test_sentences_with_a_wrong_checksum_and_other_bytes_are_left_out() -> None:
    wrong = GOOD[0].replace(b"6023", b"6024")
    received = b"\x00\xff" + GOOD[0] + wrong + b"17:30:01 " + GOOD[1] + b"$GPXXX,no end"
    assert sentences_in(received) == GOOD
    assert sentences_in(np.random.default_rng(3).bytes(1 << 20)) == []


def test_what_comes_by_udp_is_read_as_any_log(tmp_path: Path) -> None:
    port = free_port()
    with kept_navigation(str(port), tmp_path):
        send([b"".join(GOOD), np.random.default_rng(1).bytes(60_000), GOOD[1].strip()], (LOOPBACK, port))
        until(lambda: (tmp_path / NAME).stat().st_size >= sum(map(len, GOOD)) + len(GOOD[1]))
    assert (tmp_path / NAME).read_bytes() == b"".join([*GOOD, GOOD[1]])
    log = read_nmea(tmp_path / NAME, NavigationSettings(), np.array([1_782_898_201.0]), [])
    assert log is not None


def test_a_serial_line_gives_sentences_in_pieces(tmp_path: Path) -> None:
    pytest.importorskip("serial", reason="pyserial is not installed")
    ours, theirs = os.openpty()
    tty.setraw(theirs)
    with kept_navigation(f"{os.ttyname(theirs)}@38400", tmp_path):
        for piece in (GOOD[0][:20], GOOD[0][20:] + GOOD[1][:5], GOOD[1][5:]):
            os.write(ours, piece)
            time.sleep(0.05)
        until(lambda: (tmp_path / NAME).stat().st_size >= sum(map(len, GOOD)))
    os.close(ours)
    os.close(theirs)
    assert (tmp_path / NAME).read_bytes() == b"".join(GOOD)


def test_a_port_in_use_and_a_device_that_is_not_there_are_refused(tmp_path: Path) -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other:
        other.bind(("", 0))
        with pytest.raises(InputError, match="cannot be used"), kept_navigation(str(other.getsockname()[1]), tmp_path):
            pass
    with pytest.raises(InputError, match="--nmea"), kept_navigation(str(tmp_path / "ttyNONE"), tmp_path):
        pass


def test_without_a_source_there_is_no_file(tmp_path: Path) -> None:
    with kept_navigation(None, tmp_path):
        pass
    assert not (tmp_path / NAME).exists()
