"""Where the disk is waited for, packets wait in memory, and a bounded number of them."""

import hashlib
import json
import os
import subprocess
import sys
import time
from pathlib import Path
from threading import Event

import pytest

from tests.samples.command_line import ROOT
from tests.samples.live.recorded import record_while
from tests.samples.live.sender import send
from tests.samples.recordings import recording
from tests.tools.command.record.test_endings import running

MOST_MEMORY, MOST_GROWTH = 250 << 20, 16 << 20  # bytes
SHOTS, TIMES = 12_000, 10.0  # ten minutes at 20 Hz in one, which is harder for the recorder


@pytest.mark.slow
def test_nothing_is_lost_while_the_disk_takes_its_time(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Half a second, of which the receive buffer holds a half."""
    monkeypatch.setattr("sonarmap.tools.command.record.recorder._OVER", 1)  # so that the disk is waited for each second
    monkeypatch.setattr("sonarmap.tools.command.record.source.WANTED_BUFFER", 1 << 18)
    waited = list[float]()

    def fsync(_: int) -> None:
        waited.append(time.monotonic())
        time.sleep(0.5)

    monkeypatch.setattr(os, "fsync", fsync)
    packets = [packet.content for packet in recording(300)]
    status, _ = record_while(tmp_path / "dive.sonar", lambda to: send(packets, to, 400.0))
    assert len(waited) > 1
    assert status.path.read_bytes() == b"".join(packets)
    assert (status.unsaved, status.overflow, status.tally.missing) == (0, 0, 0)


def test_what_memory_does_not_hold_is_counted(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """While the first 200 packets are sent, the disk is waited for."""
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
    assert status.unsaved + status.overflow > 50  # where this computer is busy, the system loses some
    assert status.tally.packets + status.unsaved + status.overflow == len(packets)
    assert status.tally.missing <= status.unsaved + status.overflow
    assert any("is too slow" in words for words in warnings)


def memory_of(process: int) -> tuple[int, int]:
    """What a process has in memory now, and what it had at most [bytes]."""
    lines = dict(line.split(":") for line in Path(f"/proc/{process}/status").read_text().splitlines())
    return tuple(int(lines[name].split()[0]) * 1024 for name in ("VmRSS", "VmHWM"))  # type: ignore[return-value]


@pytest.mark.slow
@pytest.mark.timeout(600)
@pytest.mark.skipif(not Path("/proc/self/status").exists(), reason="memory is read where Linux tells it")
def test_ten_minutes_at_20_hz_with_one_in_a_hundred_lost(tmp_path: Path) -> None:
    """Images of the full size and an IMU, 0.6 GB; the sender is a program of its own."""
    out = tmp_path / "dive.sonar"
    with running(out, "--json") as (recorder, (_, port)):
        sending = subprocess.Popen(
            [sys.executable, "-m", "tests.samples.live.sender", str(SHOTS), str(port), str(TIMES), "0.01"],
            cwd=ROOT, stdout=subprocess.PIPE, text=True,
        )  # fmt: skip
        with sending:
            time.sleep(SHOTS / 20 / TIMES / 6)
            early, _ = memory_of(recorder.pid)
            sent = json.loads(sending.communicate()[0])
        late, most = memory_of(recorder.pid)
        recorder.terminate()
        said = json.loads(recorder.communicate()[0])
    print(f"memory {early / 2**20:.0f}, {late / 2**20:.0f}, at most {most / 2**20:.0f} MiB; {sent}; {said}")
    with out.open("rb") as file:
        assert hashlib.file_digest(file, "sha256").hexdigest() == sent["sha256"]
    out.unlink()
    assert said["packets"] == sent["packets"]
    for kind, name in (("range_images", "range"), ("strength_images", "strength"), ("imu_batches", "imu")):
        assert said["kinds"][kind]["missing"] == sent[name] > 0
    assert said["lost_here"] == {"receive_buffer": 0, "disk": 0}
    assert most < MOST_MEMORY
    assert late - early < MOST_GROWTH
