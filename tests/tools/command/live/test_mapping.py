"""The mapping in this process: what it sends where the disk takes nothing more."""

from multiprocessing import Pipe
from pathlib import Path
from signal import SIGINT, getsignal, signal
from threading import Thread
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from sonarmap.kernels.errors import InputError
from sonarmap.slam.execute.journal import Journal
from sonarmap.slam.mapper import MapperSettings
from sonarmap.tools.command.live import mapping as module
from sonarmap.tools.command.live.kept_keys import keep_key, map_keys
from sonarmap.tools.command.live.mapping import MappingSettings, run_mapping
from sonarmap.tools.command.method import MethodOptions
from sonarmap.tools.files.map_folder.folder import read_map_folder
from sonarmap.tools.files.readers.corrections import AS_RECORDED
from sonarmap.tools.files.readers.poses.trajectory import read_tum
from sonarmap.tools.products.live.messages import State
from tests.samples.clutter_scans import done, scan, sonarmap, write

FULL = "cannot be written: No space left on device"


def sent(out: Path, inputs: list[str], voxel: float | None = None) -> list[Any]:
    """What a mapping sends of finished scans until it ends."""
    pipe, other = Pipe()
    messages, before = list[Any](), getsignal(SIGINT)

    def receive() -> None:
        while (message := pipe.recv()) is not None:
            messages.append(message)
            if isinstance(message, Exception):
                return

    reader = Thread(target=receive)
    reader.start()
    method = MethodOptions(grid=64, voxel=voxel)
    settings = MappingSettings(out, tuple(inputs), 0.0, AS_RECORDED, method, MapperSettings())
    try:
        run_mapping(settings, other)
    finally:
        signal(SIGINT, before)
    reader.join()
    return messages


@pytest.mark.parametrize("what", ["keys", "points", "journal"])
def test_the_disk_is_full_and_the_map_goes_on(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, what: str) -> None:
    def refuses(*_: object) -> None:
        raise InputError(f"key_00001.npz {FULL}")

    def fails(*_: object) -> None:
        raise OSError(28, "No space left on device")

    inputs = write(tmp_path, **{f"scan_{k}": scan(k) for k in range(4)})
    out = tmp_path / "out"
    (out / "live").mkdir(parents=True)
    if what == "keys":
        monkeypatch.setattr(module, "keep_key", refuses)
    elif what == "points":
        monkeypatch.setattr(module, "PointStore", lambda _: SimpleNamespace(keep=fails))
    else:
        monkeypatch.setattr(Journal, "add", refuses)
    states = [message for message in sent(out, inputs, 0.35) if isinstance(message, State)]
    last = states[-1]
    assert (last.status, last.scans, last.placed, last.keys) == ("ended", 4, 4, 4)
    assert len(last.alerts) == 1
    assert "No space left on device" in last.alerts[0]
    assert last.alerts[0].startswith(
        "registrations cannot be saved" if what == "journal" else "the map grows in memory"
    )


def test_what_is_sent_is_the_map_that_grows(tmp_path: Path) -> None:
    inputs = write(tmp_path, **{f"scan_{k}": scan(k) for k in range(4)})
    out = tmp_path / "out"
    (out / "live").mkdir(parents=True)
    messages = sent(out, inputs, 0.35)
    names = [message[0] for message in messages if isinstance(message, tuple)]
    assert names[0] == "reset"
    assert {f"cloud {k}" for k in range(4)} | {"last", "poses 0", "loops", "coverage 0"} <= set(names)
    states = [message for message in messages if isinstance(message, State)]
    assert [state.placed for state in states][-1] == 4
    stamps = [state.stamp for state in states if state.stamp is not None]
    assert stamps == sorted(stamps)
    assert len(set(stamps)) == 4
    assert not any(state.alerts for state in states)


def simulated(folder: Path, scene: str, scans: int) -> list[Path]:
    """Scans of a simulated survey, and truth.tum beside them."""
    done(sonarmap("simulate", "--scene", scene, "--scans", str(scans), "--seed", "3", "-o", folder, "-q"))
    return sorted(folder.glob("scan_*.ply"))


@pytest.fixture(scope="module")
def rubble(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A survey of 24 scans, and in map/ what `sonarmap map` makes of every second one."""
    folder = tmp_path_factory.mktemp("onto")
    scans = simulated(folder / "scans", "rubble", 24)
    done(sonarmap("map", *scans[::2], "-o", folder / "map", "--grid", "64"))
    return folder


def replayed_onto(folder: Path, out: Path, scans: list[Path]) -> list[State]:
    (out / "live").mkdir(parents=True)
    for number, key in enumerate(map_keys(read_map_folder(folder / "map"))):
        keep_key(out, number, key)
    messages = sent(out, [str(path) for path in scans])
    assert not [message for message in messages if isinstance(message, Exception)]
    return [message for message in messages if isinstance(message, State)]


@pytest.mark.slow
def test_a_dive_is_found_in_its_place_in_a_finished_map(rubble: Path, tmp_path: Path) -> None:
    last = replayed_onto(rubble, tmp_path / "out", sorted((rubble / "scans").glob("scan_*.ply"))[1::2])[-1]
    assert (last.status, last.parts, last.part, last.scans) == ("ended", 1, 0, 12)
    assert last.own > 0
    assert last.loops >= 3
    assert last.pose is not None
    truth = read_tum(rubble / "scans" / "truth.tum").T_world_sensor
    mapped = read_tum(rubble / "map" / "trajectory.tum").T_world_sensor
    expected = mapped[11] * truth[22].inv() * truth[23]
    assert np.linalg.norm(np.array(last.pose[:3]) - expected.translation) < 0.2


@pytest.mark.slow
def test_a_dive_of_another_scene_is_a_part_of_its_own(rubble: Path, tmp_path: Path) -> None:
    states = replayed_onto(rubble, tmp_path / "out", simulated(tmp_path / "scans", "floodgate", 8))
    last = states[-1]
    assert last.parts >= 2
    assert last.part >= last.own > 0
    assert any("a separate part until a known place is seen" in state.sentence for state in states)
    assert not any(state.status in ("placed", "uncertain") for state in states)
