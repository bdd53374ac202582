"""How long after its last packet a scan is on the page of `sonarmap live`, at 5 Hz; `pytest -s` shows the figures."""

import json
import os
import signal
import subprocess
import time
from contextlib import suppress
from pathlib import Path
from threading import Thread
from urllib.parse import urlsplit

import numpy as np
import pytest
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import connect
from websockets.typing import Origin

from tests.samples.command_line import SONARMAP
from tests.samples.dives import Dive as Swim
from tests.samples.places import ROOT
from tests.samples.recordings import stamp_at

RATE = 5.0  # shots [1/s]
SHOTS = 150
FIRST = 25  # shots while the mapping begins
MEDIAN = 0.5  # delay with two idle cores [s]; other work may run beside the tests, so that twice as much passes


def arrivals(address: str, came: dict[float, float]) -> None:
    """Note when the first state of each stamp comes, until the dive ends."""
    origin = f"http://{urlsplit(address).netloc}"
    where = f"ws://{urlsplit(address).netloc}/feed"
    with suppress(ConnectionClosed), connect(where, origin=Origin(origin), compression=None, max_size=None) as feed:
        for message in feed:
            if isinstance(message, str) and (state := json.loads(message))["kind"] == "state" and state["stamp"]:
                came.setdefault(round(state["stamp"], 3), time.time())


@pytest.mark.slow
@pytest.mark.timeout(300)
def test_a_scan_is_on_the_page_soon_after_its_last_packet(tmp_path: Path) -> None:
    packets = [packet.content for packet in Swim("pool", SHOTS, rate=RATE, speed=0.4, columns=256, rows=64).packets()]
    of_shot = len(packets) // SHOTS
    shots = [b"".join(packets[first : first + of_shot]) for first in range(0, len(packets), of_shot)]
    path, out = tmp_path / "dive.part.sonar", tmp_path / "out"
    path.touch()
    command = [*SONARMAP, "live", str(path), "-o", str(out), "--no-browser", "--no-finish"]
    process = subprocess.Popen(command, cwd=ROOT, text=True, stderr=subprocess.PIPE)
    assert process.stderr is not None
    address = next(line for line in process.stderr if "shown at" in line).split("shown at ")[1].split(";")[0]
    Thread(target=process.stderr.read, daemon=True).start()
    came, sent = dict[float, float](), dict[float, float]()
    listening = Thread(target=arrivals, args=(address, came))
    listening.start()
    begun = time.time() + 3.0  # the mapping has started
    with path.open("ab", buffering=0) as recording:
        for number, shot in enumerate(shots):
            time.sleep(max(0.0, begun + number / RATE - time.time()))
            recording.write(shot)
            seconds, nanos = stamp_at(number, RATE)
            sent[round(seconds + nanos / 1e9, 3)] = time.time()
    time.sleep(3.0)
    process.send_signal(signal.SIGINT)
    assert process.wait(60) == 0
    listening.join()
    counted = list(sent)[FIRST:]
    delays = [came[stamp] - sent[stamp] for stamp in counted if stamp in came]
    print(
        f"{len(delays)} of {len(counted)} scans placed alone; from packet to page {np.median(delays):.2f} s (median), "
        f"{np.quantile(delays, 0.9):.2f} s (90th percentile), load {os.getloadavg()[0]:.1f}"
    )
    assert np.median(delays) < 2 * MEDIAN
