"""How `sonarmap record` ends as a process, and what happens to packets while the disk blocks."""

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from threading import Event

import pytest

from sonarmap.tools.files.readers.sonar.recording import Recording
from tests.samples.command_line import SONARMAP
from tests.samples.live.recorded import messages_by_wlsonar, record_while
from tests.samples.live.sender import LOOPBACK, free_port, send
from tests.samples.places import ROOT
from tests.samples.recordings import recording

PACKETS = [packet.content for packet in recording(20)]


@contextmanager
def running(
    out: Path, *options: str, limit: Callable[[], None] | None = None
) -> Iterator[tuple["subprocess.Popen[str]", tuple[str, int]]]:
    """Run `sonarmap record`; yields the process and its address once it listens."""
    port, before = free_port(), set(out.parent.iterdir())
    command = [*SONARMAP, "record", "-o", str(out), "--unicast", f"{LOOPBACK}:{port}", *options]
    pipe = subprocess.PIPE
    started = subprocess.Popen(command, cwd=ROOT, stdout=pipe, stderr=pipe, text=True, preexec_fn=limit)
    with started:
        try:
            while started.poll() is None and set(out.parent.iterdir()) == before:  # the part is made once it listens
                time.sleep(0.01)
            yield started, (LOOPBACK, port)
        finally:
            started.kill()


def shots_in(path: Path) -> int:
    return sum(1 for _ in Recording().read(path))


def until_written(path: Path, size: int, recorder: "subprocess.Popen[str]") -> None:
    while recorder.poll() is None and (not path.exists() or path.stat().st_size < size):
        time.sleep(0.01)


@pytest.mark.quick_cases(1)
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_a_signal_ends_the_recording_with_a_complete_file(tmp_path: Path, number: int) -> None:
    with running(tmp_path / "dive.sonar") as (recorder, to):
        send(PACKETS, to)
        recorder.send_signal(number)
        out, errors = recorder.communicate()
    assert recorder.returncode == 0, errors
    assert [path.name for path in tmp_path.iterdir()] == ["dive.sonar"]
    assert (tmp_path / "dive.sonar").read_bytes() == b"".join(PACKETS)
    assert len(messages_by_wlsonar(tmp_path / "dive.sonar")) == 40
    assert out.startswith(f"{tmp_path}/dive.sonar: 20 shots in 0:00:0")
    assert "lost in this computer: 0; damaged: 0" in out
    assert errors.startswith(f"listening at {to[0]}:{to[1]}; until the end the recording is in {tmp_path}/dive.part")


@pytest.mark.slow
def test_the_duration_ends_the_recording_and_json_reports_it(tmp_path: Path) -> None:
    with running(tmp_path / "dive.sonar", "--duration", "3s", "--json") as (recorder, to):
        send([*PACKETS[:10], *PACKETS[12:], *PACKETS[-2:], b"?"], to)
        out, errors = recorder.communicate()
    assert recorder.returncode == 0, errors
    summary = json.loads(out)
    once = {"came": 19, "missing": 1, "late": 0, "doubled": 1, "restarts": 0}
    assert summary["kinds"]["range_images"] == summary["kinds"]["strength_images"] == once
    assert (summary["packets"], summary["bytes"]) == (40, (tmp_path / "dive.sonar").stat().st_size)
    assert (summary["file"], summary["sonar"]) == (f"{tmp_path}/dive.sonar", LOOPBACK)
    assert (summary["damaged"], summary["lost_here"]) == (1, {"receive_buffer": 0, "disk": 0})
    assert 3.0 <= summary["seconds"] < 30.0


def test_a_crash_leaves_a_readable_part_that_the_next_recording_keeps(tmp_path: Path) -> None:
    part, size = tmp_path / "dive.part.sonar", sum(map(len, PACKETS))
    with running(tmp_path / "dive.sonar") as (recorder, to):
        send(PACKETS, to)
        until_written(part, size, recorder)
        recorder.kill()
        recorder.wait()
    assert [path.name for path in tmp_path.iterdir()] == ["dive.part.sonar"]
    assert shots_in(part) == 20
    with running(tmp_path / "dive.sonar") as (recorder, to):
        send(PACKETS[:2], to)
        recorder.terminate()
        recorder.wait()
    assert sorted(path.name for path in tmp_path.iterdir()) == ["dive.part.sonar", "dive.sonar"]
    assert (shots_in(part), shots_in(tmp_path / "dive.sonar")) == (20, 1)


LISTENER = """
import sys
import wlsonar
from sonarmap.tools.command.main import run
events = []
sys.addaudithook(lambda name, arguments: name.startswith("socket.") and events.append((name, arguments[1:])))
try:
    run()
finally:
    print(*events, sep=chr(10))
"""


@pytest.mark.parametrize("options", [("--unicast", "127.0.0.1:{}"), ("--multicast", "239.255.47.48:{}")])
@pytest.mark.slow
def test_record_binds_only_the_given_address_and_sends_nothing(tmp_path: Path, options: tuple[str, str]) -> None:
    """Checked by Python's audit events of sockets."""
    option, place = options[0], options[1].format(free_port())
    ended = subprocess.run(
        [sys.executable, "-c", LISTENER, "record", "-o", tmp_path / "a.sonar", option, place, "--duration", "0.5"],
        cwd=ROOT, capture_output=True, text=True,
    )  # fmt: skip
    if "cannot listen" in ended.stderr:
        pytest.skip("no multicast here")
    assert ended.returncode == 3, ended.stderr
    address, _, port = place.partition(":")
    events = [line for line in ended.stdout.splitlines() if "socket.__new__" not in line]
    assert events == [f"('socket.bind', (('{address}', {port}),))"]
    assert "no packet was received" in ended.stderr
    assert list(tmp_path.iterdir()) == []


@pytest.mark.slow
def test_packets_beyond_the_memory_limit_are_counted(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The disk blocks while the first 200 packets are sent."""
    monkeypatch.setattr("sonarmap.tools.command.record.recorder._OVER", 1)
    monkeypatch.setattr("sonarmap.tools.command.record.receiver.MOST_WAITING", 20)
    begins, waits, ends = Event(), Event(), Event()
    packets = [packet.content for packet in recording(250)]

    def fsync(_: int) -> None:
        if begins.is_set():
            waits.set()
            ends.wait()

    def sends(to: tuple[str, int]) -> None:
        begins.set()
        waits.wait()
        try:
            send(packets[:200], to, 400.0)
        finally:
            ends.set()
        send(packets[200:], to, 400.0)

    monkeypatch.setattr(os, "fsync", fsync)
    status, warnings = record_while(tmp_path / "dive.sonar", sends)
    assert status.unsaved > 0
    assert status.unsaved + status.overflow > 50  # on a busy computer the system loses some
    assert status.tally.packets + status.unsaved + status.overflow == len(packets)
    assert status.tally.missing <= status.unsaved + status.overflow
    assert any("is too slow" in words for words in warnings)


@pytest.mark.slow
def test_a_closed_terminal_does_not_end_the_recording(tmp_path: Path) -> None:
    with running(tmp_path / "dive.sonar") as (recorder, to):
        assert recorder.stderr is not None
        assert recorder.stdout is not None
        recorder.stderr.close()
        recorder.stdout.close()
        send([b"noise, of which it wants to warn", *PACKETS], to)
        until_written(tmp_path / "dive.part.sonar", sum(map(len, PACKETS)), recorder)
        recorder.send_signal(signal.SIGTERM)
        recorder.wait()
    assert (tmp_path / "dive.sonar").read_bytes() == b"".join(PACKETS)
