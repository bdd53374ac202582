"""`map` and `register` on bags and MCAP files: the same dive in several formats is one map."""

import json
from pathlib import Path

import numpy as np
import pytest

from sonarmap.tools.files.readers.clouds.ply import read_ply
from sonarmap.tools.files.readers.trajectory import read_tum
from sonarmap.tools.files.writers.points import write_ply
from tests.samples.bags.messages import CLOUD, IMU, ODOMETRY, PRESSURE, STAMP, cloud, imu, odometry, pressure
from tests.samples.bags.writers import Record, write_mcap, write_ros1, write_ros2
from tests.samples.cloud_files import las
from tests.samples.clutter_scans import T_WORLD_SENSOR, done, printed, refused, scan, sonarmap

GPS = STAMP - 315_964_800 + 18 - 1_000_000_000  # adjusted standard GPS time
COUNT, GRID = 3, ("--grid", "32", "--voxel", "0.6", "--loops", "0")


def table(k: int) -> np.ndarray:
    points = scan(k)
    return np.column_stack([points, np.full(len(points), 100 + k)]).astype(np.float32)


def dive() -> list[Record]:
    """A scan and a pose every two seconds."""
    records: list[Record] = []
    for k in range(COUNT):
        time, T = STAMP + 2.0 * k, T_WORLD_SENSOR[k]
        records.append(("/points", CLOUD, time, cloud(table(k), time)))
        pose = odometry(time, T.translation.tolist(), T.rotation.as_quat().tolist(), child="sonar_link")
        records.append(("/odom", ODOMETRY, time, pose))
    return records


@pytest.fixture(scope="module")
def dives(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """One dive in five formats."""
    folder = tmp_path_factory.mktemp("dives")
    paths = {name: folder / name for name in ("ply", "laz")}
    paths["laz"].mkdir()
    for k in range(COUNT):
        points = table(k)
        write_ply(paths["ply"] / f"dive{k}.ply", points[:, :3], {"intensity": points[:, 3]})
        (paths["laz"] / f"dive{k}.laz").write_bytes(las(points, gps=np.full(len(points), GPS + 2.0 * k)))
    paths |= {"mcap": write_mcap(folder / "dive.mcap", dive()), "ros2": write_ros2(folder / "dive", dive())}
    return paths | {"ros1": write_ros1(folder / "dive.bag", dive(), "lz4")}


def test_inspect_shows_the_same_for_a_bag_folder_and_its_file(
    dives: dict[str, Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = printed(sonarmap("inspect", dives["ros2"], "--json"))
    (file,) = dives["ros2"].glob("*.db3")
    alone = printed(sonarmap("inspect", file, "--json"))
    assert folder["kinds"] == ["a ROS 2 bag"]
    for name in ("scans", "points", "extent_m", "clock", "grid"):
        assert folder[name] == alone[name]
    monkeypatch.chdir(dives["ros2"])
    assert printed(sonarmap("inspect", ".", "--json"))["first"] == "dive#0"


@pytest.mark.slow
def test_all_formats_of_a_dive_give_the_same_map(dives: dict[str, Path], tmp_path: Path) -> None:
    maps, tracks = {}, {}
    for kind, path in dives.items():
        done(sonarmap("map", path, "-o", tmp_path / kind, *GRID, "--quiet"))
        (cloud,) = read_ply((tmp_path / kind / "map.ply").read_bytes())
        maps[kind], tracks[kind] = cloud.points, read_tum(tmp_path / kind / "trajectory.tum")
        first = 0.0 if kind == "ply" else STAMP
        assert tracks[kind].stamps[0] == first
    for kind in ("ros1", "ros2"):
        assert (tmp_path / kind / "map.ply").read_bytes() == (tmp_path / "mcap" / "map.ply").read_bytes()
    for kind in ("laz", "ply"):  # within a tenth of a voxel: LAZ rounds to a millimeter, and PLY has no time
        places = tracks[kind].T_world_sensor.translation
        np.testing.assert_allclose(places, tracks["mcap"].T_world_sensor.translation, atol=0.05)
        assert abs(len(maps[kind]) - len(maps["mcap"])) < 0.01 * len(maps["mcap"])


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["mcap", *(pytest.param(kind, marks=pytest.mark.slow) for kind in ("ros1", "ros2"))])
def test_odometry_is_read_from_the_recording(dives: dict[str, Path], tmp_path: Path, kind: str) -> None:
    options = ("--odometry", f"{dives[kind]}::/odom", "--odometry-drift", "1,10")
    done(sonarmap("map", dives[kind], "-o", tmp_path / "out", *GRID, *options, "--quiet"))
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    assert [s["name"] for s in summary["scans"]] == [f"dive#{k}" for k in range(COUNT)]
    result = sonarmap("map", dives["ply"], "-o", tmp_path / "other", *GRID, "--odometry", dives[kind])
    refused(result, f"error: {dives[kind]} covers 0 of the 3 scans: the rows run from {STAMP}.000 s")


@pytest.mark.slow
def test_priors_are_read_from_the_recording_of_the_scans(tmp_path: Path) -> None:
    records = dive()
    for k, T in enumerate(T_WORLD_SENSOR[:COUNT]):
        time = STAMP + 2.0 * k
        records.append(("/imu", IMU, time, imu(time, T.rotation.as_quat().tolist(), [1e-4, 1e-4, 1e-3])))
        depth = 1025 * 9.80665 * (50.0 - T.translation[2])
        records.append(("/pressure", PRESSURE, time, pressure(time, 101_325 + depth, 1e6)))
    bag = write_ros2(tmp_path / "dive", records)
    done(sonarmap("map", bag, "-o", tmp_path / "whole", *GRID, "--priors", bag))
    topics = ("--priors", f"{bag}::/imu", "--priors", f"{bag}::/pressure")
    done(sonarmap("map", bag, "-o", tmp_path / "topics", *GRID, *topics))
    tracks = [read_tum(tmp_path / name / "trajectory.tum").T_world_sensor for name in ("whole", "topics")]
    np.testing.assert_allclose(tracks[0].as_matrix(), tracks[1].as_matrix(), atol=1e-9)
    np.testing.assert_allclose(
        tracks[0].translation[:, 2], [T.translation[2] - 50 for T in T_WORLD_SENSOR[:COUNT]], atol=0.1
    )


def test_scans_of_a_recording_are_registered(dives: dict[str, Path]) -> None:
    pair = (f"{dives['ros2']}::/points#0", f"{dives['mcap']}#1")
    T = np.array(printed(sonarmap("register", *pair, *GRID[:4], "--json"))["T_target_source"])
    np.testing.assert_allclose(T, (T_WORLD_SENSOR[0].inv() * T_WORLD_SENSOR[1]).as_matrix(), atol=0.1)
    result = sonarmap("register", dives["mcap"], f"{dives['mcap']}#1")
    refused(result, "dive.mcap holds 3 scans (dive#0 to dive#2); choose one, as in")
