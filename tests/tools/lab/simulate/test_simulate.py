"""Simulations: reproducible folders, their settings and sizes, and unusable scans."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from sonarmap.kernels.errors import InputError
from sonarmap.tools.files.readers.trajectory import read_tum
from sonarmap.tools.lab.simulate.folder import read_settings, write_simulation
from sonarmap.tools.lab.simulate.sensing.noise import Noise
from sonarmap.tools.lab.simulate.sensing.sensors import ECLIPSE, SENSORS
from sonarmap.tools.lab.simulate.simulation import (
    NOISY_BEAMS,
    STRAY_ECHOES,
    SimulationSettings,
    choose_faults,
    settings_from_json,
    simulate,
)
from tests.samples.clutter_scans import files_in, refused_with_reason, said, sonarmap
from tests.samples.damage.pose_files import POSE_FILES
from tests.samples.refusals import refuses
from tests.samples.scenes.simulated import COARSE

GHOSTLY = Noise(sigma2=0.5, outliers=0.02, dropouts=0.1, ghosts=0.3, speckle=0.8)
SMALL = replace(ECLIPSE, columns=48, rows=36, threshold=0.004, edge_loss=11.0, absorption=0.05)


@pytest.mark.parametrize(
    "settings",
    [
        SimulationSettings(count=2, sensor=replace(SENSORS["sonar3d15"], max_range=80.0), seed=11),
        SimulationSettings(count=2, sensor=SMALL, noise=GHOSTLY, seed=8),
    ],
    ids=["sonar3d15", "ghosts and speckle"],
)
def test_one_seed_gives_the_same_bytes(tmp_path: Path, settings: SimulationSettings):
    first = write_simulation(simulate(settings), tmp_path / "a")
    described = read_settings(tmp_path / "a" / "description.json")
    assert described == settings
    again = write_simulation(simulate(described), tmp_path / "b")
    assert [path.name for path in first] == ["scan_000.ply", "scan_001.ply", "truth.tum", "description.json"]
    for one, other in zip(first, again, strict=True):
        assert one.read_bytes() == other.read_bytes()
    for change in ({"seed": 12}, *([{"noise": replace(GHOSTLY, ghosts=0.0)}] if settings.noise == GHOSTLY else [])):
        other = simulate(replace(settings, **change))
        assert not np.array_equal(other.scans[0].points, simulate(settings).scans[0].points)


def test_the_truth_is_written(tmp_path):
    simulation = simulate(SimulationSettings(count=3, sensor=COARSE))
    write_simulation(simulation, tmp_path)
    truth = read_tum(tmp_path / "truth.tum")
    assert_array_equal(truth.stamps, [scan.stamp for scan in simulation.scans])
    assert_allclose(truth.T_world_sensor.as_matrix(), simulation.truth.T_world_sensor.as_matrix(), atol=1e-14)
    described = json.loads((tmp_path / "description.json").read_text())
    assert [row["points"] for row in described["scans"]] == [len(scan.points) for scan in simulation.scans]


def test_a_folder_with_other_scans_is_left_alone(tmp_path):
    write_simulation(simulate(SimulationSettings(count=2, sensor=COARSE)), tmp_path)
    before = (tmp_path / "scan_000.ply").read_bytes()
    with pytest.raises(InputError, match=r"already holds scan_001\.ply"):
        write_simulation(simulate(SimulationSettings(count=1, sensor=COARSE, seed=9)), tmp_path)
    assert (tmp_path / "scan_000.ply").read_bytes() == before
    (tmp_path / "description.json").unlink()
    with pytest.raises(InputError, match=r"holds a scan_000\.ply that no simulation wrote"):
        write_simulation(simulate(SimulationSettings(count=2, sensor=COARSE)), tmp_path)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ({"scenery": "harbor"}, "scenery"),
        ({"scene": "moon"}, "floodgate, harbor, clutter"),
        ({"noise": {"sigma2": -1}}, "wanted a variance"),
        ({"sensor": {"name": "half"}}, r"sensor\.horizontal"),
        ([], "settings"),
    ],
)
def test_unusable_settings_are_named(content: object, message: str):
    refuses(message, settings_from_json, content)


@pytest.mark.parametrize("text", [None, "not json"])
def test_a_missing_or_invalid_description_is_refused(tmp_path, text: str | None):
    path = tmp_path / "description.json"
    if text is not None:
        path.write_text(text)
    refuses(r"description\.json", read_settings, path)


SETTINGS = SimulationSettings(trajectory="lawnmower", count=9, sensor=COARSE, seed=6)


@pytest.mark.parametrize(("share", "wanted"), [(0.0, 0), (0.05, 2), (0.3, 12), (0.95, 38)])
def test_the_wanted_share_is_unusable_and_never_the_first_scan(share: float, wanted: int) -> None:
    faults = choose_faults(share, 40, seed=3)
    assert len(faults) == wanted
    assert all(0 < number < 40 for number in faults)
    kinds = list(faults.values())
    assert abs(kinds.count("empty") - kinds.count("noise")) <= 1


def test_unusable_scans_have_the_points_of_their_kind_and_change_neither_the_others_nor_the_truth() -> None:
    sound, unusable = simulate(SETTINGS), simulate(replace(SETTINGS, unusable=0.45))
    assert len(unusable.faults) == 4
    assert_array_equal(sound.truth.T_world_sensor.as_matrix(), unusable.truth.T_world_sensor.as_matrix())
    for number, (one, other) in enumerate(zip(sound.scans, unusable.scans, strict=True)):
        assert (other.stamp, other.name) == (one.stamp, one.name)
        if number not in unusable.faults:
            assert_array_equal(one.points, other.points)
            assert_array_equal(one.strength, other.strength)
    beams = COARSE.rows * COARSE.columns
    for number, kind in unusable.faults.items():
        scan = unusable.scans[number]
        low, high = STRAY_ECHOES if kind == "empty" else [round(share * beams) for share in NOISY_BEAMS]
        assert low <= len(scan.points) <= high
        ranges = np.linalg.norm(scan.points, axis=1)
        assert (ranges > COARSE.min_range - 1e-4).all()
        assert (ranges < COARSE.max_range + 1e-4).all()


def test_the_description_names_unusable_scans_and_like_repeats_them(tmp_path: Path) -> None:
    options = ["--trajectory", "lawnmower", "--dive", "2", "--scans", "4", "--seed", "6", "--quiet", "--set"]
    assert sonarmap("simulate", *options, "unusable=0.25", "-o", tmp_path / "a").exit_code == 0
    described = json.loads((tmp_path / "a" / "description.json").read_text())
    assert (described["settings"]["unusable"], described["settings"]["dive"]) == (0.25, 2)
    kinds = [row["unusable"] for row in described["scans"]]
    assert kinds.count(None) == 3
    again = sonarmap("simulate", "--like", tmp_path / "a" / "description.json", "-o", tmp_path / "b", "--quiet")
    assert again.exit_code == 0
    assert files_in(tmp_path / "a") == files_in(tmp_path / "b")
    refused = sonarmap("simulate", *options, "unusable=1.5", "-o", tmp_path / "c")
    assert refused.exit_code == 2
    said(refused, "unusable is 1.5")


LARGE = ("GiB of memory", "this machine has", "give at most")


def description(folder: Path, **values: float) -> Path:
    """A description.json with other values for settings or for the sensor."""
    content = json.loads(POSE_FILES["description.json"].content)
    for name, value in values.items():
        part = content["settings"] if name in content["settings"] else content["settings"]["sensor"]
        part[name] = value
    path = folder / "description.json"
    path.write_text(json.dumps(content))
    return path


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({"count": 10**12}, ("scans of", *LARGE)),
        ({"columns": 10**12}, ("columns and", *LARGE)),
        ({"max_range": 1e6}, ("max_range <= 100000 m",)),  # no reader takes more
    ],
)
def test_a_too_large_simulation_is_refused(tmp_path: Path, values: dict[str, float], words: tuple[str, ...]) -> None:
    result = sonarmap("simulate", "--like", description(tmp_path, **values), "-o", tmp_path / "out")
    refused_with_reason(result)
    said(result, "error: ", *words)
    assert not (tmp_path / "out").exists()
