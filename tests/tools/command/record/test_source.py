"""Addresses that are refused in words, and where the socket is bound."""

import errno
import socket
from ipaddress import IPv4Address
from pathlib import Path

import pytest
import wlsonar

from sonarmap.kernels.errors import InputError
from sonarmap.tools.command.record.source import GROUP, Source, open_socket, overflow_of, source_of, system_buffer
from tests.samples.clutter_scans import refused, sonarmap
from tests.samples.live.sender import LOOPBACK, free_port


def test_the_sonars_own_group_is_the_default() -> None:
    assert f"{wlsonar.DEFAULT_MCAST_GRP}:{wlsonar.DEFAULT_MCAST_PORT}" == GROUP
    assert source_of(None, None, None) == Source(IPv4Address("224.0.0.96"), 4747)
    assert source_of("239.1.2.3:5000", None, "eth7").words == "239.1.2.3:5000 on eth7"
    assert source_of(None, "10.1.2.3:5000", None).words == "10.1.2.3:5000"


@pytest.mark.parametrize(
    ("options", "wanted"),
    [
        (["--multicast", "224.0.0.96"], "wanted an IPv4 address in numbers and a port"),
        (["--multicast", ""], "wanted an IPv4 address"),
        (["--multicast", "[ff02::60]:4747"], "wanted an IPv4 address"),
        (["--multicast", "sonar:4747"], "wanted an IPv4 address"),
        (["--multicast", "224.0.0.96:0"], "wanted a port from 1 to 65535"),
        (["--multicast", "224.0.0.96:65536"], "wanted a port from 1 to 65535"),
        (["--multicast", "224.0.0.96:²"], "wanted a port from 1 to 65535"),
        (["--multicast", "224.0.0.96: 47"], "wanted a port from 1 to 65535"),
        (["--multicast", "192.168.194.96:4747"], "For an address of this computer give --unicast"),
        (["--unicast", "224.0.0.96:4747"], "give --multicast 224.0.0.96:4747"),
        (["--unicast", "4747"], "wanted an IPv4 address"),
        (["--unicast", "192.0.2.77:4747"], "Give an address of this computer in the sonar's network"),
        (["--unicast", "0.0.0.0:4747", "--interface", "eth0"], "--interface has no effect with --unicast"),
        (["--unicast", "0.0.0.0:4747", "--multicast", GROUP], "--multicast has no effect with --unicast"),
        (["--interface", "nosuch0"], "The interfaces of this computer are lo"),
        (["--interface", "192.0.2.77"], "The interfaces of this computer are lo"),
        (["--interface", ""], "The interfaces of this computer are lo"),
        (["--sonar", "sonar"], "--sonar 192.168.194.96"),
        (["--duration", "0"], "--duration 90, 10m or 1.5h"),
        (["--duration", "-5"], "--duration 90, 10m or 1.5h"),
        (["--duration", "nan"], "--duration 90, 10m or 1.5h"),
        (["--duration", "5 days"], "--duration 90, 10m or 1.5h"),
    ],
)
def test_a_bad_option_is_refused_in_words(tmp_path: Path, options: list[str], wanted: str) -> None:
    result = sonarmap("record", "-o", tmp_path / "a.sonar", *options)
    refused(result, wanted)
    assert result.stderr.startswith("error: ")
    assert list(tmp_path.iterdir()) == []


def test_a_file_that_is_there_is_kept(tmp_path: Path) -> None:
    out = tmp_path / "dive.sonar"
    out.write_bytes(b"older")
    command = ("record", "-o", out, "--unicast", f"{LOOPBACK}:{free_port()}", "--duration", "0.1")
    refused(sonarmap(*command), "--overwrite")
    assert sonarmap(*command, "--overwrite").exit_code == 3  # nothing came, and nothing is replaced
    assert [(path.name, path.read_bytes()) for path in tmp_path.iterdir()] == [("dive.sonar", b"older")]


@pytest.mark.parametrize(("name", "wanted"), [("dive.bag", "does not end in .sonar"), ("folder.sonar", "a folder of")])
def test_a_name_that_cannot_be_is_refused(tmp_path: Path, name: str, wanted: str) -> None:
    (tmp_path / "folder.sonar").mkdir()
    place = f"{LOOPBACK}:{free_port()}"
    refused(sonarmap("record", "-o", tmp_path / name, "--unicast", place, "--overwrite"), wanted)


def test_a_port_that_is_taken_is_refused(tmp_path: Path) -> None:
    source = Source(IPv4Address(LOOPBACK), free_port())
    with open_socket(source) as listening:
        assert listening.getsockname() == (LOOPBACK, source.port)
        assert system_buffer(listening) > 65_507
        with pytest.raises(InputError, match="Another program listens there"):
            open_socket(source)


def test_ports_that_need_permission_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    def denied(*_: object) -> None:
        raise OSError(errno.EACCES, "Permission denied")

    monkeypatch.setattr(socket.socket, "bind", denied)
    with pytest.raises(InputError, match=r"Permission denied\. Ports below 1024"):
        open_socket(Source(IPv4Address(LOOPBACK), 80))


@pytest.mark.skipif(not hasattr(socket, "SO_REUSEPORT") or not Path("/proc").exists(), reason="Linux counts these")
def test_what_the_system_loses_is_counted() -> None:
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
