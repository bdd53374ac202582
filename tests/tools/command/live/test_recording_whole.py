"""`sonarmap live` while something fails beside its recording: the file holds every byte that was sent."""

import os
import signal
import subprocess
import sys
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from threading import Thread

import pytest

from sonarmap.tools.command.live.recording import recorder_of
from tests.samples.dives import Dive as Swim
from tests.samples.live.sender import LOOPBACK, free_port, send
from tests.samples.places import ROOT
from tests.tools.command.live.waiting import mapping_of, until

pytestmark = [pytest.mark.slow, pytest.mark.timeout(300)]

# run at the start of every process of the command; only one of them is broken
IN_MAPPING = "import sys\nif '--multiprocessing-fork' in sys.orig_argv:\n"
IN_LIVE = "import sys\nif 'live' in sys.orig_argv:\n"
MAPPER = """
    from sonarmap.slam.live.growing import GrowingMap
    def spoiled(*arguments, **more):
        raise RuntimeError("spoiled 7")
    GrowingMap.add = spoiled
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
    said: list[str] = field(default_factory=list[str])

    def listen(self) -> None:
        """Collect the lines of its stderr."""
        assert self.process.stderr is not None
        with suppress(ValueError):
            self.said.extend(line.decode() for line in self.process.stderr)


def stopped(dive: Dive) -> None:
    """Stop the mapping process once it has a key scan."""
    until((dive.out / "live" / "key_00000.npz").is_file, 60)
    number = mapping_of(dive.process)
    assert number is not None
    os.kill(number, signal.SIGSTOP)


def nothing(_: Dive) -> None:
    pass


# name -> code in one of the processes, action meanwhile, and expected message
FAULTS: dict[str, tuple[str, Callable[[Dive], None], str]] = {
    "mapping raises": (IN_MAPPING + MAPPER, nothing, "the mapping ended (RuntimeError: spoiled 7"),
    "mapping hangs": ("", stopped, ""),
    "page dies": (IN_LIVE + PAGE, nothing, ""),
    "terminal full": ("", nothing, ""),
}


@pytest.fixture(scope="module")
def swim() -> list[bytes]:
    """Packets of 30 shots through a pool."""
    return [packet.content for packet in Swim("pool", 30, rate=5.0, speed=0.4, columns=96, rows=32).packets()]


@pytest.mark.parametrize("fault", FAULTS)
def test_the_recording_is_complete(swim: list[bytes], tmp_path: Path, fault: str) -> None:
    code, meanwhile, words = FAULTS[fault]
    (tmp_path / "code").mkdir()
    (tmp_path / "code" / "sitecustomize.py").write_text(code)
    port, out = free_port(), tmp_path / "out"
    command = [sys.executable, "-m", "sonarmap", "live", "-o", str(out), "--no-browser", "--no-finish"]
    command += ["--unicast", f"{LOOPBACK}:{port}", "--grid", "64", "--voxel", "0.35"]
    paths = os.pathsep.join([str(tmp_path / "code"), str(ROOT), os.environ.get("PYTHONPATH", "")])
    with Path("/dev/full").open("wb") as full:
        stderr = full if fault == "terminal full" else subprocess.PIPE
        environment = os.environ | {"PYTHONPATH": paths}
        process = subprocess.Popen(command, cwd=tmp_path, stderr=stderr, env=environment)
    dive = Dive(out, process)
    if stderr == subprocess.PIPE:
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
