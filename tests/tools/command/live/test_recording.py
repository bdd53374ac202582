"""The recording process: its files hold every packet, whichever process is killed meanwhile."""

import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from threading import Event, Thread

import pytest

from sonarmap.kernels.errors import InputError
from sonarmap.tools.command.live.recording import RecordingProcess
from tests.samples.live.sender import LOOPBACK, free_port, send
from tests.samples.places import ROOT
from tests.samples.recordings import recording
from tests.tools.command.live.waiting import until

PACKETS = [packet.content for packet in recording(20)]
OWNERS = list["subprocess.Popen[str]"]()  # to end after the test
OWNER = """
import sys, time
from pathlib import Path
from sonarmap.tools.command.live.recording import RecordingProcess
owner = RecordingProcess(Path(sys.argv[1]), sys.argv[2:])
while True:
    owner.look()
    while owner.said:
        print(owner.said.popleft(), flush=True)
    time.sleep(0.1)
"""


def recorders(out: Path) -> list[int]:
    """Ids of the processes that record to a map's folder."""
    found = list[int]()
    for process in Path("/proc").glob("[0-9]*"):
        with suppress(OSError):
            if f"\0{out}/recording/".encode() in (process / "cmdline").read_bytes():
                found.append(int(process.name))
    return found


def files(out: Path) -> list[str]:
    return sorted(path.name for path in (out / "recording").glob("*.sonar"))


def size(out: Path, name: str) -> int:
    path = out / "recording" / name
    return path.stat().st_size if path.exists() else -1


@pytest.fixture
def to(tmp_path: Path) -> Iterator[tuple[str, int]]:
    """Address to send to; ends all recorders after the test."""
    yield LOOPBACK, free_port()
    while OWNERS:
        OWNERS.pop().kill()
    for number in recorders(tmp_path):
        with suppress(ProcessLookupError):
            os.kill(number, signal.SIGKILL)


def options(to: tuple[str, int]) -> list[str]:
    return ["--unicast", f"{to[0]}:{to[1]}"]


def sent(out: Path, name: str, packets: list[bytes], to: tuple[str, int]) -> None:
    """Send packets to a recorder that listens, until all are in its file."""
    until(lambda: size(out, name) >= 0)
    whole = size(out, name) + sum(map(len, packets))
    send(packets, to)
    until(lambda: size(out, name) >= whole)


def new_messages(process: RecordingProcess) -> list[str]:
    """Messages since the last call."""
    process.look()
    lines = list(process.said)
    process.said.clear()
    return lines


def begun(out: Path, to: tuple[str, int]) -> RecordingProcess:
    """A recording process that listens."""
    process = RecordingProcess(out, options(to))
    until(lambda: size(out, "001.part.sonar") >= 0)
    return process


def owned(out: Path, to: tuple[str, int], program: str = OWNER) -> "subprocess.Popen[str]":
    """A process that owns a recording process and prints its messages."""
    command = [sys.executable, "-c", program, str(out), *options(to)]
    OWNERS.append(subprocess.Popen(command, cwd=ROOT, text=True, stdout=subprocess.PIPE, stderr=subprocess.PIPE))
    return OWNERS[-1]


def test_all_packets_are_in_the_file_which_is_renamed_at_the_end(tmp_path: Path, to: tuple[str, int]) -> None:
    process = begun(tmp_path, to)
    sent(tmp_path, "001.part.sonar", PACKETS[:15], to)
    assert new_messages(process) == []
    sent(tmp_path, "001.part.sonar", PACKETS[15:], to)
    process.end()
    assert files(tmp_path) == ["001.sonar"]
    assert (tmp_path / "recording" / "001.sonar").read_bytes() == b"".join(PACKETS)
    assert recorders(tmp_path) == []
    process.end()  # a second call has no effect


@pytest.mark.slow
@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGTERM])
def test_a_repeatedly_killed_recorder_starts_again(tmp_path: Path, to: tuple[str, int], number: int) -> None:
    """It restarts at once, then after 1, 3 and 7 s, until `stop` is set.

    A killed recorder leaves a file, so the next one has another name; a terminated one without packets leaves none.
    """
    process, stop = begun(tmp_path, to), Event()
    keeping = Thread(target=process.keep_on, args=(stop,))
    keeping.start()
    names = [f"{count:03d}" if number == signal.SIGKILL else "001" for count in range(1, 5)]
    for count, name in enumerate(names[:-1], start=1):
        until(lambda part=f"{name}.part.sonar": len(recorders(tmp_path)) == 1 and size(tmp_path, part) >= 0)
        os.kill(recorders(tmp_path)[0], number)
        until(lambda count=count: sum("begins again" in line for line in process.said) == count)
    sent(tmp_path, f"{names[-1]}.part.sonar", PACKETS, to)
    stop.set()
    keeping.join()
    restarts = [line for line in process.said if "begins again" in line]
    assert [line.rpartition(" file")[2] for line in restarts] == ["", " in 1 s", " in 3 s"]
    assert (tmp_path / "recording" / f"{names[-1]}.sonar").read_bytes() == b"".join(PACKETS)
    assert recorders(tmp_path) == []


@pytest.mark.slow
@pytest.mark.skipif(not Path("/proc/self/cmdline").exists(), reason="needs /proc")
def test_a_recorder_outlives_its_owner_and_the_next_owner_takes_over(
    tmp_path: Path, to: tuple[str, int], monkeypatch: pytest.MonkeyPatch
) -> None:
    owner = owned(tmp_path, to)
    sent(tmp_path, "001.part.sonar", PACKETS[:6], to)
    owner.kill()
    owner.wait()
    sent(tmp_path, "001.part.sonar", PACKETS[6:10], to)
    before = recorders(tmp_path)
    monkeypatch.chdir(tmp_path.parent)
    process = RecordingProcess(Path(tmp_path.name), options(to))  # the same folder by another path
    assert recorders(tmp_path) == before
    assert new_messages(process) == []
    sent(tmp_path, "001.part.sonar", PACKETS[10:], to)
    process.end()
    assert files(tmp_path) == ["001.sonar"]
    assert (tmp_path / "recording" / "001.sonar").read_bytes() == b"".join(PACKETS)
    assert recorders(tmp_path) == []


def test_a_recorder_starts_another_file_when_one_cannot_grow(tmp_path: Path, to: tuple[str, int]) -> None:
    """The file reaches its size limit within the twelfth packet."""
    most = sum(map(len, PACKETS[:11])) + 5
    limited = f"import resource; resource.setrlimit(resource.RLIMIT_FSIZE, ({most}, {most}))"
    owner = owned(tmp_path, to, f"{limited}\n{OWNER}")
    until(lambda: size(tmp_path, "001.part.sonar") >= 0)
    send(PACKETS[:12], to)
    until(lambda: size(tmp_path, "002.part.sonar") >= 0)
    sent(tmp_path, "002.part.sonar", PACKETS[12:20], to)
    owner.kill()
    out, _ = owner.communicate()
    assert "001.part.sonar cannot grow: File too large" in out
    assert "the recording has ended, and begins again in another file" in out
    content = [(tmp_path / "recording" / name).read_bytes() for name in files(tmp_path)]
    assert content == [b"".join(PACKETS[:11]), b"".join(PACKETS[12:20])]


def test_a_file_in_place_of_the_folder_is_refused(tmp_path: Path, to: tuple[str, int]) -> None:
    (tmp_path / "recording").write_bytes(b"7")
    with pytest.raises(InputError, match=r"cannot record to .*recording: File exists"):
        RecordingProcess(tmp_path, options(to))
