"""`sonarmap live` end to end: its map equals that of `sonarmap map`, even if a process is killed meanwhile."""

import json
import os
import signal
import struct
import subprocess
import time
from collections import deque
from collections.abc import Sequence
from functools import partial
from multiprocessing import Pipe
from multiprocessing.connection import Connection
from pathlib import Path
from threading import Event, Thread
from typing import Any, cast
from urllib.parse import urlsplit
from urllib.request import urlopen

import pytest
from websockets.sync.client import connect
from websockets.typing import Origin

from sonarmap.kernels.errors import DeviceError, InputError
from sonarmap.spectral.scan import Scan
from sonarmap.tools.command.live import dive as module
from sonarmap.tools.command.live.chosen import kept_chosen
from sonarmap.tools.command.live.dive import Dive, KilledError
from sonarmap.tools.command.live.kept_keys import KeptKey, keep_key, kept_keys
from sonarmap.tools.command.live.recording import Again
from sonarmap.tools.files.finding import Remedy
from sonarmap.tools.files.readers.incoming import Mark
from sonarmap.tools.products.live.messages import State
from tests.samples.clutter_scans import done, refused, scan, sonarmap, write
from tests.samples.command_line import SONARMAP
from tests.samples.dives import Dive as Swim
from tests.samples.live.sender import LOOPBACK, free_port, send
from tests.samples.places import ROOT
from tests.tools.command.live.waiting import mapping_of, until

OPTIONS = ("--grid", "64", "--voxel", "0.35")
VARYING = {"times.json", "journal.sqlite"}
KILLED = "the mapping was killed, perhaps for lack of memory, and goes on from the last key scan"

pytestmark = pytest.mark.timeout(600)


def live(out: Path, *arguments: str | Path) -> "subprocess.Popen[str]":
    command = [*SONARMAP, "live", *map(str, arguments), "-o", str(out), "--no-browser", *OPTIONS]
    pipe = subprocess.PIPE
    return subprocess.Popen(command, cwd=ROOT, text=True, stdout=pipe, stderr=pipe, start_new_session=True)


def ended(process: "subprocess.Popen[str]", code: int = 0) -> str:
    """Wait for the process, check its exit code, and return its stderr."""
    _, lines = process.communicate()
    assert process.returncode == code, lines
    return lines


def results(out: Path) -> dict[str, bytes]:
    """Files that every run of `sonarmap map` writes identically."""
    return {path.name: path.read_bytes() for path in out.iterdir() if path.is_file() and path.name not in VARYING}


def key(out: Path, number: int) -> Path:
    return out / "live" / f"key_{number:05d}.npz"


@pytest.fixture(scope="module")
def clutter(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Four small scans, a second apart, and their map in out/."""
    folder = tmp_path_factory.mktemp("clutter")
    write(folder, **{f"scan_{k}": scan(k) for k in range(4)})
    done(sonarmap("map", folder, "-o", folder / "out", *OPTIONS))
    return folder


@pytest.mark.slow
def test_live_makes_the_same_map_as_map(clutter: Path, tmp_path: Path) -> None:
    lines = ended(live(tmp_path, clutter, "--replay", "0"))
    assert results(tmp_path) == results(clutter / "out")
    assert not (tmp_path / "live").exists()
    assert "The dive has ended; 4 of 4 scans placed" in lines


@pytest.mark.slow
def test_the_page_becomes_the_report_before_live_ends(clutter: Path, tmp_path: Path) -> None:
    process = live(tmp_path, clutter, "--replay", "1")
    assert process.stderr is not None
    address = urlsplit(next(line for line in process.stderr if "shown at" in line).split("shown at ")[1].split(";")[0])
    origin = Origin(f"http://{address.netloc}")
    with connect(f"ws://{address.netloc}/feed", origin=origin, compression=None, max_size=None) as feed:
        texts = list[dict[str, Any]]()
        while not texts or texts[-1]["kind"] != "made":
            texts += [json.loads(message) for message in [feed.recv(120)] if isinstance(message, str)]
        with urlopen(f"{origin}/report") as response:
            report = response.read()
    ended(process)
    assert report == (tmp_path / "report.html").read_bytes()
    assert [text["status"] for text in texts if text["kind"] == "state"][-1] == "ended"
    assert any("map is being made" in text["words"] for text in texts if text["kind"] == "making")


@pytest.mark.slow
@pytest.mark.skipif(not Path("/proc/self/task").exists(), reason="needs /proc")
def test_a_killed_mapping_process_continues_from_the_last_key_scan(clutter: Path, tmp_path: Path) -> None:
    """A second `sonarmap live` in the same folder is refused meanwhile."""
    process = live(tmp_path, clutter, "--replay", "1")
    until(key(tmp_path, 1).is_file)
    before = key(tmp_path, 1).stat().st_mtime_ns
    number = mapping_of(process)
    assert number is not None
    os.kill(number, signal.SIGKILL)
    refused(sonarmap("live", clutter, "--replay", "0", "-o", tmp_path, "--no-browser", *OPTIONS), "is in use")
    until(key(tmp_path, 2).is_file)
    assert key(tmp_path, 1).stat().st_mtime_ns == before
    assert KILLED in ended(process)
    assert results(tmp_path) == results(clutter / "out")


@pytest.mark.slow
def test_a_killed_command_continues_from_the_last_key_scan(clutter: Path, tmp_path: Path) -> None:
    process = live(tmp_path, clutter, "--replay", "0.5")
    until(key(tmp_path, 1).is_file)
    before = key(tmp_path, 1).stat().st_mtime_ns
    process.kill()
    process.communicate()
    process = live(tmp_path, clutter, "--replay", "0.5")
    until(key(tmp_path, 2).is_file)
    assert key(tmp_path, 1).stat().st_mtime_ns == before
    ended(process)
    assert results(tmp_path) == results(clutter / "out")


@pytest.mark.slow
@pytest.mark.parametrize("seconds", [0.1, 1.5])
def test_ctrl_c_ends_the_dive_without_a_traceback(clutter: Path, tmp_path: Path, seconds: float) -> None:
    """A terminal sends SIGINT to all processes of the group, at any stage."""
    process = live(tmp_path, clutter, "--no-finish")
    assert process.stderr is not None
    assert "Ctrl-C ends the dive" in process.stderr.readline()
    time.sleep(seconds)
    os.killpg(process.pid, signal.SIGINT)
    assert "Traceback" not in ended(process)


@pytest.fixture(scope="module")
def swim() -> list[bytes]:
    """Packets of 40 shots through a pool, 8 s at 5 shots/s."""
    return [packet.content for packet in Swim("pool", 40, rate=5.0, speed=0.4, columns=96, rows=32).packets()]


@pytest.mark.slow
def test_network_packets_are_recorded_and_mapped(swim: list[bytes], tmp_path: Path) -> None:
    port, out = free_port(), tmp_path / "out"
    process = live(out, "--unicast", f"{LOOPBACK}:{port}")
    until((out / "recording" / "001.part.sonar").exists)
    send(swim, (LOOPBACK, port), 20.0)
    until((key(out, 1)).is_file)
    process.send_signal(signal.SIGINT)
    ended(process)
    assert (out / "recording" / "001.sonar").read_bytes() == b"".join(swim)
    done(sonarmap("map", out / "recording", "-o", tmp_path / "map", *OPTIONS))
    assert results(out) == results(tmp_path / "map")


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("nowhere",), "nowhere does not exist; name a growing recording"),
        (("scan.ply",), "scan.ply is neither a folder nor a recording that may grow (.sonar, .mcap); give --replay 1"),
        (("--replay", "0"), "--replay needs finished scans"),
        (("--bind", "192.0.2.7", "--duration", "9"), "192.0.2.7 cannot be used for the page"),
        (("--export", "laz"), "give --origin"),
        (("--device", "none7"), "none7"),
        (("--onto", "empty"), "empty"),
        (("--nmea", "192.0.2.7:10110"), "192.0.2.7:10110 cannot be used"),
    ],
)
def test_invalid_inputs_and_options_are_refused(
    arguments: tuple[str, ...], words: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "empty").mkdir()
    for name in ("scan.ply", "a.sonar", "b.sonar"):
        (tmp_path / name).write_bytes(b"7")
    refused(sonarmap("live", *arguments, "-o", "out", "--no-browser"), words)


def a_dive(is_recorded: bool = False, page: Any = None, lines: list[str] | None = None) -> Dive:
    """A dive that maps nothing; its messages go to `lines`."""

    def tell(_: State, new: list[str]) -> None:
        if lines is None:
            raise OSError(28, "No space left on device")  # the terminal is closed
        lines.extend(new)

    return Dive(lambda chosen: cast(Any, chosen), Path(), cast(Any, page or Shows()), tell, is_recorded)


def test_a_truncated_message_means_that_the_mapping_was_killed() -> None:
    pipe, other = Pipe()
    os.write(other.fileno(), struct.pack("!i", 1000) + b"cut")
    other.close()
    with pytest.raises(KilledError):
        a_dive()._took(pipe)


class Shows:
    """A page that keeps the states it was given."""

    def __init__(self) -> None:
        self.states, self.choices, self.chosen = list[dict[str, Any]](), frozenset[str](), deque[str]()

    def publish(self, message: tuple[str, str]) -> None:
        self.states.append(json.loads(message[1]))


@pytest.mark.parametrize("error", [InputError("no memory for 7 scans"), ValueError("7"), MemoryError(), OSError(5, "")])
def test_while_recording_the_mapping_restarts_after_any_error(
    monkeypatch: pytest.MonkeyPatch, error: Exception
) -> None:
    begun, stop = list[int](), Event()

    def fails(_: Dive, __: Event) -> bool:
        begun.append(7)
        if len(begun) == 3:
            stop.set()
        raise error

    monkeypatch.setattr(Dive, "_map_until", fails)
    monkeypatch.setattr(Again, "pause", lambda _: 0.0)
    lines, page = list[str](), Shows()
    a_dive(True, page, lines).follow(stop)
    assert lines == [f"the mapping ended ({error}), and goes on from the last key scan"] * 2
    assert page.states[-1]["alerts"] == lines[:1]
    assert page.states[-2]["sentence"].startswith("The recording goes on")
    assert page.states[-1]["sentence"] == "The dive has ended."


@pytest.mark.parametrize(("error", "most"), [(InputError("no scans"), 1), (DeviceError("gone"), 1), (ValueError(), 6)])
def test_without_a_recording_the_mapping_gives_up(monkeypatch: pytest.MonkeyPatch, error: Exception, most: int) -> None:
    begun = list[int]()

    def fails(_: Dive, __: Event) -> bool:
        begun.append(7)
        raise error

    monkeypatch.setattr(Dive, "_map_until", fails)
    monkeypatch.setattr(Again, "pause", lambda again: setattr(again, "failures", again.failures + 1) or 0.0)
    with pytest.raises(type(error)):
        a_dive().follow(Event())
    assert len(begun) == most


UPSIDE_DOWN = Remedy("correct_priors", ("roll_deg=180+roll_deg",))
SCALED = Remedy("range_scale", ("0.97",))


def tells(chosen: Sequence[Remedy], pipe: Connection) -> None:
    """A mapping that has an alert until a remedy is chosen, and then another, and ends once both are."""
    remedies = [remedy for remedy in (UPSIDE_DOWN, SCALED) if remedy not in chosen][:1]
    alerts = tuple(f"wrong: {remedy}" for remedy in remedies)
    pipe.send(State("placed", alerts=alerts, remedies=tuple(remedies)))
    if len(chosen) == 2:
        pipe.send(None)
    while True:
        time.sleep(0.1)


@pytest.mark.parametrize("undone", [False, True])
def test_a_remedy_that_is_chosen_on_the_page_restarts_the_mapping(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, undone: bool
) -> None:
    monkeypatch.setattr(module, "_map", tells)
    monkeypatch.setattr(module, "_PATIENCE", 0.1)
    (tmp_path / "live").mkdir()
    for number, behind in enumerate([Mark(), Mark("a", 3)]):
        keep_key(tmp_path, number, KeptKey(Scan(scan(1), stamp=float(number)), None, behind, 0.5))
    lines, keys = list[str](), list[int]()
    page, dive = Shows(), a_dive(lines=lines)
    dive.page, dive.out = cast(Any, page), tmp_path
    clicks = [f"Use {UPSIDE_DOWN}"]
    clicks += [f"Do not use {UPSIDE_DOWN} any more", f"Use {UPSIDE_DOWN}"] if undone else []
    clicks.append(f"Use {SCALED}")

    def click() -> None:
        for label in clicks:
            until(partial(lambda label: label in page.choices, label))
            page.chosen.append(label)
            until(partial(lambda label: label not in page.choices, label))
            keys.append(len(list(kept_keys(tmp_path))))

    clicking = Thread(target=click)
    clicking.start()
    dive.follow(Event())
    clicking.join()
    assert dive.chosen == kept_chosen(tmp_path) == [UPSIDE_DOWN, SCALED]
    assert keys == [2] * (len(clicks) - 1) + [1]  # scaled scans are placed again, without those of a finished map
    assert lines[:3] == [
        f"wrong: {UPSIDE_DOWN}", f"{UPSIDE_DOWN} is used from here on, as chosen on the page",
        f"wrong: {UPSIDE_DOWN if undone else SCALED}",
    ] or undone  # fmt: skip
    assert page.states[-1]["alerts"] == []
    assert [f"Do not use {SCALED} any more"] in [state["choices"] for state in page.states]
    assert page.states[-1]["choices"] == []  # nothing can be chosen after the dive


@pytest.mark.slow
def test_a_wrong_sign_is_corrected_by_a_click(tmp_path: Path) -> None:
    """The final map is made with the option, and says so."""
    done(sonarmap("simulate", "--scene", "rubble", "--scans", "30", "--seed", "4", "--priors",
                  "attitude,heading,depth,position", "-o", tmp_path / "dive", "-q"))  # fmt: skip
    log = tmp_path / "dive" / "priors.csv"
    rows = [line.split(",") for line in log.read_text().splitlines()]
    column = rows[0].index("heading_deg")
    log.write_text("\n".join(",".join(
        [*row[:column], row[column] if k == 0 else str(-float(row[column]) % 360), *row[column + 1 :]]
    ) for k, row in enumerate(rows)) + "\n")  # fmt: skip
    process = live(tmp_path / "out", tmp_path / "dive", "--replay", "2", "--priors", log)
    assert process.stderr is not None
    address = urlsplit(next(line for line in process.stderr if "shown at" in line).split("shown at ")[1].split(";")[0])
    wanted = "Use --correct-priors heading_deg=-heading_deg"
    with connect(
        f"ws://{address.netloc}/feed", origin=Origin(f"http://{address.netloc}"), compression=None, max_size=None
    ) as feed:
        state: dict[str, Any] = {"choices": []}
        while wanted not in state["choices"]:
            message = feed.recv(120)
            state = json.loads(message) if isinstance(message, str) and '"kind": "state"' in message else state
        feed.send(wanted)
    lines = ended(process)
    assert "--correct-priors heading_deg=-heading_deg is used from here on, as chosen on the page" in lines
    assert "--correct-priors heading_deg=-heading_deg was chosen on the page" in lines
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    assert summary["settings"]["correct_priors"] == "heading_deg=-heading_deg"
    assert summary["warnings"] == []


def dies(_: object, __: object) -> None:
    os.kill(os.getpid(), signal.SIGKILL)


@pytest.mark.slow
def test_a_mapping_that_is_killed_repeatedly_gives_up(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "_map", dies)
    with pytest.raises(InputError, match="for lack of memory; 'sonarmap doctor'"):
        a_dive().follow(Event())
