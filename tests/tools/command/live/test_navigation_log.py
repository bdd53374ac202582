"""Recording of NMEA sentences from UDP or a serial line, and navigation from logs that grow."""

import io
import os
import pickle
import socket
import time
import tty
from pathlib import Path

import numpy as np
import pytest

from sonarmap.kernels.errors import InputError
from sonarmap.spectral.scan import Scan
from sonarmap.tools.command.live.navigation import NAME, Navigation, NavigationLog, sentences_in
from sonarmap.tools.command.navigation import NavigationReading, OdometryFile, PriorsFile
from sonarmap.tools.files.readers.navigation.nmea import read_nmea
from sonarmap.tools.files.readers.navigation.settings import NavigationSettings
from tests.samples.clutter_scans import scan
from tests.samples.live.sender import LOOPBACK, free_port, send
from tests.tools.command.live.waiting import until

FIX = b"$GPGGA,093001.00,6023.478,N,00519.326,E,1,09,0.9,-3.2,M,45.1,M,,*"
HEADING = b"$HEHDT,123.4,T*"


def sentence(body: bytes) -> bytes:
    checksum = 0
    for byte in body[1:-1]:
        checksum ^= byte
    return body + f"{checksum:02X}\r\n".encode()


GOOD = [sentence(FIX), sentence(HEADING)]


def test_sentences_with_a_wrong_checksum_and_other_bytes_are_left_out() -> None:
    wrong = GOOD[0].replace(b"6023", b"6024")
    received = b"\x00\xff" + GOOD[0] + wrong + b"17:30:01 " + GOOD[1] + b"$GPXXX,no end"
    assert sentences_in(received) == GOOD
    assert sentences_in(np.random.default_rng(3).bytes(1 << 20)) == []


def test_sentences_received_by_udp_are_read_as_a_log(tmp_path: Path) -> None:
    port = free_port()
    with NavigationLog(str(port), tmp_path):
        send([b"".join(GOOD), np.random.default_rng(1).bytes(60_000), GOOD[1].strip()], (LOOPBACK, port))
        until(lambda: (tmp_path / NAME).stat().st_size >= sum(map(len, GOOD)) + len(GOOD[1]))
    assert (tmp_path / NAME).read_bytes() == b"".join([*GOOD, GOOD[1]])
    log = read_nmea(tmp_path / NAME, NavigationSettings(), np.array([1_782_898_201.0]), [])
    assert log is not None


@pytest.mark.parametrize(("host", "packets"), [("", 1), ("127.0.0.1:", 1), ("0.0.0.0:", 2)])
def test_packets_of_other_computers_are_received_at_0_0_0_0(tmp_path: Path, host: str, packets: int) -> None:
    """Packets to 127.0.0.2 stand for them, as they do not reach 127.0.0.1."""
    port = free_port()
    with NavigationLog(f"{host}{port}", tmp_path):
        for address in ("127.0.0.2", LOOPBACK):
            send(GOOD[:1], (address, port))
        until(lambda: (tmp_path / NAME).stat().st_size >= packets * len(GOOD[0]))
    assert (tmp_path / NAME).read_bytes() == GOOD[0] * packets


def test_silence_and_its_end_are_reported(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("sonarmap.tools.command.live.navigation._SILENT", 0.5)
    port = free_port()
    with NavigationLog(str(port), tmp_path) as log:
        until(lambda: log.said)
        assert f"no sentence has come at {port}" in log.said[0]
        assert f"--nmea 0.0.0.0:{port}" in log.said[0]
        send(GOOD, (LOOPBACK, port))
        until(lambda: len(log.said) > 1)
        assert "resolved" in log.said[1]


class Line:
    """A serial device that keeps its name, as /dev/ttyUSB0, when it is unplugged and plugged in."""

    def __init__(self, folder: Path) -> None:
        self.path = folder / "ttyUSB7"
        self.plug()

    def plug(self) -> None:
        self.ours, self._theirs = os.openpty()
        tty.setraw(self._theirs)
        self.path.symlink_to(os.ttyname(self._theirs))

    def unplug(self) -> None:
        self.path.unlink()
        os.close(self.ours)
        os.close(self._theirs)


@pytest.fixture
def line(tmp_path: Path) -> Line:
    pytest.importorskip("serial", reason="pyserial is not installed")
    return Line(tmp_path)


def test_pieces_of_sentences_from_a_serial_line_are_joined(tmp_path: Path, line: Line) -> None:
    with NavigationLog(f"{line.path}@38400", tmp_path):
        for piece in (GOOD[0][:20], GOOD[0][20:] + GOOD[1][:5], GOOD[1][5:]):
            os.write(line.ours, piece)
            time.sleep(0.05)
        until(lambda: (tmp_path / NAME).stat().st_size >= sum(map(len, GOOD)))
    line.unplug()
    assert (tmp_path / NAME).read_bytes() == b"".join(GOOD)


def test_an_unplugged_device_is_opened_again(tmp_path: Path, line: Line) -> None:
    with NavigationLog(str(line.path), tmp_path) as log:
        for count in (1, 2, 3):
            os.write(line.ours, GOOD[0])
            until(lambda count=count: (tmp_path / NAME).stat().st_size >= count * len(GOOD[0]))
            line.unplug()
            until(lambda count=count: len(log.said) == 2 * count - 1)
            assert f"{line.path} has gone" in log.said[-1]
            line.plug()
            until(lambda count=count: len(log.said) == 2 * count)
            assert "resolved" in log.said[-1]
    assert (tmp_path / NAME).read_bytes() == 3 * GOOD[0]


def test_a_full_disk_is_reported_and_sentences_are_written_later(tmp_path: Path) -> None:
    port, path = free_port(), tmp_path / NAME
    path.symlink_to("/dev/full")
    with NavigationLog(str(port), tmp_path) as log:
        send(GOOD, (LOOPBACK, port))
        until(lambda: log.said)
        assert "No space left on device" in log.said[0]
        path.unlink()
        send(GOOD[:1], (LOOPBACK, port))
        until(lambda: path.exists() and path.stat().st_size >= sum(map(len, GOOD)) + len(GOOD[0]))
        until(lambda: len(log.said) == 2)
    assert path.read_bytes() == b"".join([*GOOD, GOOD[0]])


def test_a_partial_write_is_continued(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    class Slow(io.FileIO):
        # pyrefly: ignore[bad-override]
        def write(self, content: bytes) -> int:
            return super().write(content[:7])

    monkeypatch.setattr(Path, "open", lambda path, mode, buffering=0: Slow(path, mode.replace("b", "")))
    port = free_port()
    with NavigationLog(str(port), tmp_path):
        send(GOOD, (LOOPBACK, port))
        until(lambda: (tmp_path / NAME).stat().st_size >= sum(map(len, GOOD)))
    assert (tmp_path / NAME).read_bytes() == b"".join(GOOD)


def test_a_port_in_use_and_a_missing_device_are_refused(tmp_path: Path) -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other:
        other.bind(("", 0))
        with pytest.raises(InputError, match="cannot be used"), NavigationLog(str(other.getsockname()[1]), tmp_path):
            pass
    for source in (str(tmp_path / "ttyNONE"), "192.0.2.77:10110", "70000"):
        with pytest.raises(InputError, match="--nmea"), NavigationLog(source, tmp_path):
            pass


SCANS = [Scan(scan(0)[:50], stamp=100.0 + k, name=f"dive#{k}") for k in range(5)]
HEAD = "stamp,roll_deg,pitch_deg,heading_deg,x_m,y_m,depth_m\n"


def row(stamp: float) -> str:
    return f"{stamp},0,0,90,{stamp - 100},2,3\n"


def navigation(priors: Path | None = None, odometry: Path | None = None) -> Navigation:
    return pickle.loads(
        pickle.dumps(
            Navigation(
                PriorsFile([] if priors is None else [priors], None if priors is None else "0.5,3,0.1,3"),
                OdometryFile(odometry),
                NavigationReading(),
            )
        )
    )


def eastings_of(scans: list[Scan], given: Navigation) -> list[float | None]:
    """Eastings of the scans' priors [m]."""
    priors = [each.prior for each in given(scans)[0]]
    return [None if prior is None else round(float(prior.T_world_sensor.translation[0]), 6) for prior in priors]


def test_scans_get_priors_from_a_growing_log(tmp_path: Path) -> None:
    path = tmp_path / "navigation.csv"
    given = navigation(path)
    assert eastings_of(SCANS, given) == [None] * 5  # there is no file yet
    path.write_text(HEAD)
    assert eastings_of(SCANS, given) == [None] * 5
    rows = [row(stamp) for stamp in np.arange(99.75, 104.5, 0.5)]
    path.write_text(HEAD + "".join(rows[:6]) + rows[6][:9])  # within a line
    assert eastings_of(SCANS, given) == [0.0, 1.0, 2.0, None, None]
    path.write_text(HEAD + "".join(rows))
    assert eastings_of(SCANS, given) == [0.0, 1.0, 2.0, 3.0, 4.0]


def test_an_unreadable_log_leaves_the_scans_unchanged(tmp_path: Path) -> None:
    path = tmp_path / "navigation.csv"
    path.write_text(HEAD + "".join(map(row, np.arange(99.75, 104.5, 0.5))))
    scans, _ = navigation(path)(SCANS)
    path.write_bytes(b"\xff\x00 no table\n")
    again, _ = navigation(path)(scans)
    assert again == scans


@pytest.mark.parametrize("cut", [0, 12])
def test_dead_reckoning_covers_only_scans_within_the_file(tmp_path: Path, cut: int) -> None:
    path = tmp_path / "odometry.tum"
    text = "".join(f"{stamp} {stamp - 100} 0 0 0 0 0 1\n" for stamp in np.arange(99.5, 103.1, 0.5))
    path.write_text(text[: len(text) - cut])
    _, odometry = navigation(odometry=path)(SCANS)
    assert odometry is not None
    assert odometry.scans.tolist() == ([0, 1, 2, 3] if cut == 0 else [0, 1, 2])
    np.testing.assert_allclose(odometry.T_odom_sensor.translation[:, 0], odometry.scans, atol=1e-9)
    assert navigation(odometry=tmp_path / "nothing.tum")(SCANS)[1] is None


def test_what_is_wrong_with_a_log_is_reported(tmp_path: Path) -> None:
    """Rows that cannot be right at once; a log that cannot be used if that lasts for ten seconds of the dive."""
    path = tmp_path / "navigation.csv"
    stamps = np.arange(99.75, 104.5, 0.25)
    path.write_text(HEAD + "".join(map(row, stamps)).replace(",2,3\n", ",2,-9999\n", 3))
    given = navigation(path)
    given(SCANS)
    (fault,) = given.faults
    assert fault.startswith(f"{path}: 3 depths are left out")
    assert "-9999" in fault
    path.write_text(HEAD + "".join(map(row, stamps + 3600)))
    given(SCANS)
    assert given.faults == []  # it may have begun late
    later = [*SCANS, Scan(scan(0)[:50], stamp=114.5)]
    given(later)
    (fault,) = given.faults
    assert fault.startswith(f"--priors is not used: {path}: no row is at the time of a scan")
    path.write_text(HEAD + "".join(map(row, stamps)))
    given(later)
    assert given.faults == []
