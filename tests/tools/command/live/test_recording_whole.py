"""`sonarmap live` while something fails beside its recording: the file holds every byte that was sent."""

import os
import re
import signal
import socket
import subprocess
import sys
import time
import tty
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from threading import Thread
from urllib.parse import urlsplit

import pytest

from sonarmap.tools.command.live.recording import recorder_of
from tests.samples.command_line import ROOT
from tests.samples.dives import Dive as Swim
from tests.samples.live.sender import LOOPBACK, free_port, send
from tests.tools.command.live.test_navigation_log import GOOD
from tests.tools.command.live.waiting import until

pytestmark = [pytest.mark.slow, pytest.mark.timeout(300)]

# in every process of the command before it does anything; of these only one is spoiled
IN_MAPPING = "import sys\nif '--multiprocessing-fork' in sys.orig_argv:\n"
IN_LIVE = "import sys\nif 'live' in sys.orig_argv:\n"
READER = """
    from sonarmap.tools.command.live import mapping
    whole = mapping.incoming
    def incoming(*arguments):
        for number, scan in enumerate(whole(*arguments)):
            if number == 3:
                raise {}
            yield scan
    mapping.incoming = incoming
"""
MAPPER = """
    from sonarmap.slam.live.growing import GrowingMap
    def spoiled(*arguments, **more):
        raise RuntimeError("spoiled 7")
    GrowingMap.add = spoiled
"""
NO_ROOM = """
    from sonarmap.kernels.errors import InputError
    from sonarmap.tools.command.live import mapping
    def refuse(*_):
        raise InputError("cannot be written: No space left on device")
    mapping.keep_key = mapping.Journal = refuse
"""
PAGE = """
    from threading import Timer
    from sonarmap.tools.products.live.server import LivePage
    def end(page):
        page._loop.call_soon_threadsafe(page._loop.stop)
        Timer(1.5, end, [page]).start()
    enter = LivePage.__enter__
    def spoiled(page):
        Timer(1.0, end, [page]).start()
        return enter(page)
    LivePage.__enter__ = spoiled
"""


@dataclass
class Dive:
    """A `sonarmap live` with a fault in it."""

    out: Path
    process: "subprocess.Popen[bytes]"
    line: tuple[int, int]  # a serial device, ttyUSB7
    said: list[str] = field(default_factory=list[str])

    def listen(self) -> None:
        """Take what it says on stderr."""
        assert self.process.stderr is not None
        with suppress(ValueError):
            self.said.extend(line.decode() for line in self.process.stderr)

    @property
    def mapping(self) -> int | None:
        """The process that maps."""
        for child in Path(f"/proc/{self.process.pid}/task/{self.process.pid}/children").read_text().split():
            with suppress(OSError):
                if b"spawn_main" in Path(f"/proc/{child}/cmdline").read_bytes():
                    return int(child)
        return None

    def signal_mapping(self, number: int, times: int = 1) -> None:
        """Once it has a key scan."""
        until((self.out / "live" / "key_00000.npz").is_file, 60)
        for _ in range(times):
            until(lambda: self.mapping is not None, 60)
            with suppress(ProcessLookupError):
                os.kill(self.mapping or 0, number)
            time.sleep(0.5)


def killed(dive: Dive) -> None:
    dive.signal_mapping(signal.SIGKILL, 3)


def stopped(dive: Dive) -> None:
    dive.signal_mapping(signal.SIGSTOP)


def damaged(dive: Dive) -> None:
    path = dive.out / "live" / "key_00000.npz"
    until(path.is_file, 60)
    content = bytearray(path.read_bytes())
    content[len(content) // 2] ^= 1
    path.write_bytes(content)
    dive.signal_mapping(signal.SIGKILL)


def no_terminal(dive: Dive) -> None:
    assert dive.process.stderr is not None
    os.close(dive.process.stderr.fileno())


def unplugged(dive: Dive) -> None:
    (dive.out.parent / "ttyUSB7").unlink()
    for number in dive.line:
        os.close(number)


def bad_viewer(dive: Dive) -> None:
    until(lambda: dive.said, 60)
    port = urlsplit(re.findall(r"http://\S+/", dive.said[0])[0]).port or 0
    for content in (os.urandom(1 << 20), b"GET / HTTP/1.1\r\nHost: evil\r\n\r\n", b""):
        with suppress(OSError), socket.create_connection((LOOPBACK, port), timeout=5) as viewer:
            viewer.sendall(content)


def wrong_priors(dive: Dive) -> None:
    (dive.out.parent / "priors.csv").write_bytes(b"stamp,depth_m\n1,nan\n\xff\x00\n7,1e999,3\n")


def no_room_for_navigation(dive: Dive) -> None:
    path = dive.out / "navigation.nmea"
    path.unlink()
    path.symlink_to("/dev/full")
    send(GOOD, (LOOPBACK, NMEA))


def nothing(_: Dive) -> None:
    pass


NMEA = free_port()
# name -> code in one of the processes, what is done meanwhile, further options, and what is said
FAULTS: dict[str, tuple[str, Callable[[Dive], None], tuple[str, ...], str]] = {
    "reader ValueError": (IN_MAPPING + READER.format("ValueError('7')"), nothing, (), "scans cannot be read: Value"),
    "reader MemoryError": (IN_MAPPING + READER.format("MemoryError()"), nothing, (), "scans cannot be read: Memory"),
    "reader OSError": (IN_MAPPING + READER.format("OSError(5, 'I/O')"), nothing, (), "scans cannot be read: OSErr"),
    "mapping raises": (IN_MAPPING + MAPPER, nothing, (), "the mapping ended (RuntimeError: spoiled 7"),
    "mapping killed": ("", killed, (), "the mapping was killed"),
    "mapping hangs": ("", stopped, (), ""),
    "no room for the map": (IN_MAPPING + NO_ROOM, nothing, (), "the map grows in memory alone"),
    "page dies": (IN_LIVE + PAGE, nothing, (), ""),
    "terminal closed": ("", no_terminal, (), ""),
    "terminal full": ("", nothing, (), ""),
    "key scan damaged": ("", damaged, (), "key_00000.npz is damaged and left out"),
    "device unplugged": ("", unplugged, ("--nmea", "ttyUSB7"), "has gone"),
    "no room for navigation": ("", no_room_for_navigation, ("--nmea", str(NMEA)), "No space left on device"),
    "viewer sends noise": ("", bad_viewer, (), ""),
    "wrong priors": ("", wrong_priors, ("--priors", "priors.csv"), ""),
}


@pytest.fixture(scope="module")
def swim() -> list[bytes]:
    """Packets of 30 shots through a pool."""
    return [packet.content for packet in Swim("pool", 30, rate=5.0, speed=0.4, columns=96, rows=32).packets()]


@pytest.mark.parametrize("fault", FAULTS)
def test_the_recording_is_whole(swim: list[bytes], tmp_path: Path, fault: str) -> None:
    code, meanwhile, options, words = FAULTS[fault]
    (tmp_path / "code").mkdir()
    (tmp_path / "code" / "sitecustomize.py").write_text(code)
    line = os.openpty()
    tty.setraw(line[1])
    (tmp_path / "ttyUSB7").symlink_to(os.ttyname(line[1]))
    port, out = free_port(), tmp_path / "out"
    command = [sys.executable, "-m", "sonarmap", "live", "-o", str(out), "--no-browser", "--no-finish", *options]
    command += ["--unicast", f"{LOOPBACK}:{port}", "--grid", "64", "--voxel", "0.35"]
    paths = os.pathsep.join([str(tmp_path / "code"), str(ROOT), os.environ.get("PYTHONPATH", "")])
    with Path("/dev/full").open("wb") as full:
        stderr = full if fault == "terminal full" else subprocess.PIPE
        environment = os.environ | {"PYTHONPATH": paths}
        process = subprocess.Popen(command, cwd=tmp_path, stderr=stderr, env=environment)
    dive = Dive(out, process, line)
    if stderr == subprocess.PIPE and fault != "terminal closed":
        Thread(target=dive.listen, daemon=True).start()
    try:
        until((out / "recording" / "001.part.sonar").exists)
        sending = Thread(target=send, args=(swim, (LOOPBACK, port), 10.0))
        sending.start()
        meanwhile(dive)
        sending.join()
        if words:
            until(lambda: words in "".join(dive.said), 180)
        until(lambda: (out / "recording" / "001.part.sonar").stat().st_size >= sum(map(len, swim)))
        assert process.poll() is None
        process.send_signal(signal.SIGINT)
        assert process.wait(60) == 0
    finally:
        print(*dive.said)
        process.kill()
        if (recorder := recorder_of(out)) is not None:
            os.kill(recorder, signal.SIGKILL)
    assert [path.name for path in (out / "recording").glob("*.sonar")] == ["001.sonar"]
    assert (out / "recording" / "001.sonar").read_bytes() == b"".join(swim)
