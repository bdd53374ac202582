"""The mapping, run in this process: its messages, also with a full disk; key scans of a map; the backlog of scans."""

import time
from collections.abc import Iterator
from multiprocessing import Pipe
from pathlib import Path
from signal import SIGINT, getsignal, signal
from threading import Thread
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from sonarmap.kernels.errors import InputError
from sonarmap.slam.execute.journal import Journal
from sonarmap.slam.graph.trajectory import Trajectory
from sonarmap.slam.mapper_settings import MapperSettings
from sonarmap.spectral.scan import Scan
from sonarmap.tools.command.live import mapping as module
from sonarmap.tools.command.live.kept_keys import keep_key, map_keys
from sonarmap.tools.command.live.mapping import Backlog, MappingSettings, run_mapping
from sonarmap.tools.command.method import MethodOptions
from sonarmap.tools.files.map_folder.folder import Map, MapPart, read_map_folder
from sonarmap.tools.files.readers.incoming import Incoming, Mark
from sonarmap.tools.files.readers.scans import AS_RECORDED
from sonarmap.tools.files.readers.trajectory import read_tum
from sonarmap.tools.products.live.messages import State
from tests.samples.clutter_scans import done, scan, sonarmap, write
from tests.tools.command.live.waiting import until

FULL = "cannot be written: No space left on device"


def sent(out: Path, inputs: list[str], voxel: float | None = None) -> list[Any]:
    """Messages of a mapping of finished scans until it ends."""
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
def test_mapping_continues_with_a_full_disk(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, what: str) -> None:
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


def test_messages_describe_the_growing_map(tmp_path: Path) -> None:
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
    """A survey of 24 scans, and in map/ the map of every second one."""
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
def test_a_dive_is_placed_in_a_finished_map(rubble: Path, tmp_path: Path) -> None:
    last = replayed_onto(rubble, tmp_path / "out", sorted((rubble / "scans").glob("scan_*.ply"))[1::2])[-1]
    assert (last.status, last.parts, last.part, last.scans) == ("ended", 1, 0, 12)
    assert last.own > 0
    assert last.loops >= 3
    assert last.pose is not None
    truth = read_tum(rubble / "scans" / "truth.tum").T_world_sensor
    mapped = read_tum(rubble / "map" / "trajectory.tum").T_world_sensor
    expected = mapped[11] * truth[22].inv() * truth[23]
    assert np.linalg.norm(np.array(last.pose[:3]) - expected.translation) < 0.2


VOXEL = 0.25
HALF_VIEW, REACH = np.radians(40.0), 6.0  # of the sensor that made the map


def map_of(spacing: float, count: int = 9) -> tuple[Map, RigidTransform]:
    """A map of a 30 m wall seen from a track along it; each point belongs to the nearest scan."""
    x = np.arange(count) * spacing
    R = Rotation.from_euler("ZYX", np.column_stack([np.full(count, np.pi / 2), 0.02 * x, 0.03 * np.sin(x)]))
    T = RigidTransform.from_components(np.column_stack([x - 1.0, 0.1 * x, np.full(count, -2.0)]), R)
    wall = np.stack(np.meshgrid(np.arange(-10, 20, 0.2), [4.0], np.arange(-4, 0, 0.2), indexing="ij"), -1).reshape(
        -1, 3
    )
    near = np.argmin(np.linalg.norm(wall[:, None] - T.translation, axis=2), axis=1)
    local = RigidTransform.concatenate([T[k] for k in near]).inv().apply(wall)
    seen = (np.linalg.norm(local, axis=1) < REACH) & (local[:, 0] > np.cos(HALF_VIEW) * np.linalg.norm(local, axis=1))
    wall, near = wall[seen], near[seen]
    scans = tuple(range(3, 3 + count))
    columns = {"scan": near + 3}
    trajectory = Trajectory(50.0 + np.arange(count), T)
    part = MapPart("", wall, columns, scans, trajectory, np.zeros((count, 6, 6)), in_world=True)
    names = tuple(f"old{k}" for k in range(3 + count))
    return Map(Path("map"), names, (part,), (), VOXEL, {}, None, {}), T


def test_key_scans_are_spaced_and_have_the_poses_of_the_map() -> None:
    folder, T = map_of(spacing=1.0)
    keys = list(map_keys(folder))
    assert [key.scan.name for key in keys] == [
        "map:old3",
        "map:old5",
        "map:old7",
        "map:old9",
        "map:old11",
    ]  # more than 8 voxels of 0.25 m
    assert [key.scan.stamp for key in keys] == [50.0, 52.0, 54.0, 56.0, 58.0]
    prior = keys[0].scan.prior
    assert prior is not None
    assert prior.is_complete
    np.testing.assert_allclose(prior.T_world_sensor.as_matrix(), T[0].as_matrix(), atol=1e-12)
    assert keys[0].step is None
    for key, step in zip(keys[1:], T[:-2:2].inv() * T[2::2], strict=True):
        assert key.scan.prior is None
        assert key.step is not None
        np.testing.assert_allclose(key.step.T_target_source.as_matrix(), step.as_matrix(), atol=1e-12)
    assert all(key.behind == Mark() and key.voxel == VOXEL for key in keys)


def test_a_key_scan_includes_points_of_other_scans_in_its_view() -> None:
    folder, T = map_of(spacing=1.0)
    key = list(map_keys(folder))[1]
    points = key.scan.points.astype(np.float64)
    far = np.linalg.norm(points, axis=1)
    assert far.max() < REACH
    assert (points[:, 0] / far).min() > np.cos(HALF_VIEW) - 1e-6
    own_points = T[2].inv().apply(folder.parts[0].points[folder.parts[0].columns["scan"] == 5])
    assert len(points) > 2 * len(own_points)
    world = T[2].apply(points)
    np.testing.assert_allclose(world[:, 1], 4.0, atol=1e-5)  # on the wall, in the map's frame


def test_a_map_with_too_few_points_per_scan_is_refused() -> None:
    folder, _ = map_of(spacing=1.0)
    part = folder.parts[0]
    few = MapPart(
        "", part.points[:40], {"scan": part.columns["scan"][:40]}, part.scans, part.trajectory, part.covariances, True
    )
    with pytest.raises(InputError, match="no scan of the map has 50 points"):
        list(map_keys(Map(Path("map"), folder.names, (few,), (), VOXEL, {}, None, {})))


MOST = 256


def scans(count: int, pulled: list[int] | None = None) -> Iterator[Incoming]:
    points = scan(0)[:50]
    for number in range(count):
        if pulled is not None:
            pulled.append(number)
        yield Incoming(Scan(points, stamp=float(number)), Mark("dive", number + 1), missing=number // 3)


def test_the_number_of_waiting_scans_is_limited() -> None:
    pulled: list[int] = []
    backlog = Backlog(scans(300, pulled))
    assert backlog.wait(30, least=MOST) == MOST
    time.sleep(0.05)
    assert len(pulled) == MOST + 1  # the reading thread holds the last one
    backlog.drop(7)
    until(lambda: len(pulled) == MOST + 8 and backlog.wait(0) == MOST)
    assert (backlog[0].behind, backlog[MOST - 1].behind) == (Mark("dive", 8), Mark("dive", MOST + 7))
    assert not backlog.ended
    backlog.drop(MOST)
    until(lambda: backlog.ended)
    assert (backlog.wait(0), backlog.missing, backlog.error) == (300 - MOST - 7, 99, None)


def test_waiting_without_scans_times_out() -> None:
    def silent() -> Iterator[Incoming]:
        time.sleep(0.4)
        yield from scans(2)

    backlog = Backlog(silent())
    assert (backlog.wait(0.01), backlog.ended) == (0, False)
    assert backlog.wait(30) >= 1


@pytest.mark.parametrize(("error", "words"), [(InputError("no disk 7"), "no disk 7"), (OSError(5, "gone"), "gone")])
def test_an_error_is_reported_after_the_scans_before_it(error: Exception, words: str) -> None:
    def failing() -> Iterator[Incoming]:
        yield from scans(3)
        raise error

    backlog = Backlog(failing())
    assert backlog.wait(30, least=9) == 3
    assert isinstance(backlog.error, InputError)
    assert words in str(backlog.error)
