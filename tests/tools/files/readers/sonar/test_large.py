"""An hour of recording: time and memory of a process of its own; and thousands of damaged recordings."""

import json
import subprocess
import sys
import zlib
from pathlib import Path

import pytest

from sonarmap.tools.files.memory import peak_memory
from sonarmap.tools.files.readers.clouds.cloud import Cloud
from sonarmap.tools.files.readers.sonar.recording import stream_sonar
from tests.samples.places import ROOT
from tests.samples.processor_time import processor_time
from tests.samples.recordings import damage_a_shot, disturbed, recording, written

MOST_MEMORY, MOST_SECONDS = 1 << 30, 120.0  # of the processor
LONGEST = 5.0  # seconds of the processor for a damaged recording


def run(code: str, *arguments: str) -> str:
    ended = subprocess.run([sys.executable, "-c", code, *arguments], cwd=ROOT, capture_output=True, text=True)
    assert ended.returncode == 0, ended.stderr
    return ended.stdout


@pytest.mark.slow
def test_an_hour_at_5_hz_streams_below_a_gibibyte(tmp_path: Path) -> None:
    """18,000 shots with losses of every kind, which are noted; the rest is unchanged."""
    clean = list(recording(18_000, first=2**32 - 9_000))
    packets, events = disturbed(clean, seed=1)
    lost = damage_a_shot(packets, events, 5_000)
    path = written(tmp_path / "dive.sonar", packets)
    code = "from tests.tools.files.readers.sonar.test_large import main; main()"
    digests, seconds, memory, notes = json.loads(run(code, str(path)))
    shots = len(digests)
    print(f"{path.stat().st_size / 1e6:.0f} MB, {shots / seconds:.0f} shots/s, {memory / 2**20:.0f} MiB; {notes}")
    whole = [digest(cloud) for cloud in stream_sonar(written(tmp_path / "clean.sonar", clean), [])]
    assert digests == [whole[shot] for shot in range(18_000) if shot not in lost]
    assert "1 damaged packet left out" in " ".join(notes)
    assert memory < MOST_MEMORY
    assert seconds < MOST_SECONDS


def digest(cloud: Cloud) -> int:
    """Of all points, to the last bit."""
    return zlib.crc32(cloud.points.tobytes())


def main() -> None:
    """Print what streaming the recording takes, and what is in it."""
    start, notes = processor_time(), list[str]()
    digests = [digest(cloud) for cloud in stream_sonar(Path(sys.argv[1]), notes)]
    seconds = processor_time() - start
    peak = peak_memory()
    print(json.dumps([digests, seconds, peak, notes]))
