"""`sonarmap inspect`: summaries of recordings, scans and logs, in words and as JSON."""

import json
import os
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from sonarmap.slam.survey_grid import survey_grid
from sonarmap.tools.command.navigation import PriorsFile, scans_with_priors
from sonarmap.tools.files.readers.navigation.settings import AS_IT_SAYS
from sonarmap.tools.files.readers.scans import read_scans, read_survey
from tests.samples.clutter_scans import done, printed, refused, said, scan, sonarmap, write
from tests.samples.recordings import imu_packets, shot_packets
from tests.tools.files.readers.navigation.logs import START


@pytest.fixture(scope="module")
def dive(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """60 shots at 5 Hz, three of them lost, with an IMU, and two speeds of sound."""
    path = tmp_path_factory.mktemp("dive") / "dive.sonar"
    imu = imu_packets(12.0, lambda _: np.array([0.0, -9.81 * 0.5, -9.81 * np.sqrt(0.75)]), np.zeros(3))
    with path.open("wb") as file:
        for shot in range(60):
            file.write(b"".join(imu[2 * shot : 2 * shot + 2]))
            if shot not in (20, 21, 40):
                rng = np.random.default_rng(shot)
                packets = shot_packets(shot, 100 + shot, rng, 1480.0 if shot < 30 else 1485.5)
                file.write(b"".join(packet.content for packet in packets[: 1 if shot == 5 else 2]))
    os.utime(path, (1_700_000_100, 1_700_000_100))
    return path


def as_json(*arguments: Any) -> dict[str, Any]:
    return printed(sonarmap("inspect", *arguments, "--json"))


class TestRecording:
    def test_a_recording_as_json(self, dive: Path) -> None:
        found = as_json(dive)
        assert (found["scans"], found["first"], found["last"]) == (57, "dive#0", "dive#56")
        clock = found["clock"]
        assert (clock["start_utc"], clock["end_utc"]) == ("2023-11-14 22:13:20", "2023-11-14 22:13:32")
        assert clock["rate_hz"] == pytest.approx(5.0)
        assert (clock["gaps"], clock["longest_step_s"]) == (2, pytest.approx(0.6))
        assert (found["strengths"], found["viewpoints"]) == (56, 0)
        assert found["sound_speed_mps"] == [1480.0, 1485.5]
        assert found["attitudes"] == 57
        np.testing.assert_allclose(found["roll_pitch_deg"], [30.0, 0.0], atol=1e-3)
        assert [note.partition(": ")[2] for note in found["notes"]] == [
            "3 of 60 shots are missing by their numbers",
            "1 of 57 shots have no strength image",
            "the speed of sound changes once, between 1480.0 and 1485.5 m/s",
            "dropped 139 of 34,315 points within 5 cm of the sensor, which are no returns",
        ]
        assert (found["bytes"], found["changed"]) == (dive.stat().st_size, 1_700_000_100)

    def test_inspect_and_map_choose_the_same_grid(self, dive: Path) -> None:
        grid = survey_grid(read_survey([dive]).scans)
        assert as_json(dive)["grid"] == {"edge": grid.edge, "voxel": grid.voxel}
        assert as_json(dive, "--grid", 64)["grid"]["voxel"] == pytest.approx(2 * grid.voxel)

    def test_sound_speed_and_range_scale_change_the_summary(self, dive: Path) -> None:
        plain, scaled = as_json(dive), as_json(dive, "--range-scale", 1.5)
        np.testing.assert_allclose(scaled["extent_m"], 1.5 * np.array(plain["extent_m"]), rtol=1e-3)
        faster = as_json(dive, "--sound-speed", 1500)
        assert plain["farthest_m"] < faster["farthest_m"] < 1.02 * plain["farthest_m"]


class TestOtherFormats:
    def test_a_folder_of_scans_as_json(self, tmp_path: Path) -> None:
        write(tmp_path, a=scan(0), b=scan(1)[:5000])
        found = as_json(tmp_path)
        assert (found["scans"], found["first"], found["last"]) == (2, "a", "b")
        assert found["points"] == {"least": 5000, "median": 6100.0, "most": 7200}
        assert (found["clock"], found["sound_speed_mps"], found["roll_pitch_deg"]) == (None, None, None)
        low, high = np.quantile(scan(0), [0.01, 0.99], axis=0)
        assert np.abs(np.array(found["extent_m"]) - (high - low)).max() < 1.0
        assert "not recorded: the scans are numbered" in sonarmap("inspect", tmp_path).stdout

    def test_unreadable_files_are_reported_and_the_others_summarized(self, tmp_path: Path) -> None:
        write(tmp_path, a=scan(0), b=scan(1))
        (tmp_path / "c.ply").write_bytes(b"ply\nnot at all\n")
        shown = sonarmap("inspect", tmp_path)
        assert shown.exit_code == 3
        said(shown, "cannot be read")
        assert "2: a to b" in shown.stdout

    def test_sound_speed_is_refused_for_a_format_without_one(self, tmp_path: Path) -> None:
        write(tmp_path, a=scan(0))
        words = ("--sound-speed cannot be used, as a PLY file has no speed; give --range-scale",)
        for verb in (["inspect"], ["map", "-o", tmp_path / "out"]):
            refused(sonarmap(*verb, tmp_path / "a.ply", "--sound-speed", "1490"), *words)


class TestImuOption:
    @pytest.fixture
    def pair(self, tmp_path: Path) -> Path:
        """A recording of two shots of boxes, with an IMU; a file of priors."""
        (tmp_path / "nav.csv").write_text("name,depth_m,depth_sigma_m\ndive#0,5,0.1\ndive#1,5,0.1\n")
        imu = imu_packets(2.0, lambda _: np.array([0.0, 0.0, -9.81]), np.zeros(3))
        shots = [packet.content for shot in (2, 4) for packet in shot_packets(shot, shot, np.random.default_rng(1))]
        (tmp_path / "dive.sonar").write_bytes(b"".join([*imu, *shots]))
        return tmp_path

    @pytest.mark.parametrize(
        ("imu", "nav", "words"),
        [
            (True, None, "2 of 2 scans: roll and pitch are those of the recording's own IMU"),
            (False, None, "2 of 2 scans: their own IMU is not used"),
            (True, "nav.csv", "2 of 2 scans: the recording's own IMU is not used, as {} is given"),
        ],
    )
    def test_the_use_of_the_imu_is_reported(
        self, pair: Path, imu: bool, nav: str | None, words: str, capsys: pytest.CaptureFixture[str]
    ) -> None:
        scans, priors = read_scans([pair / "dive.sonar"]).scans, nav and pair / nav
        navigated = scans_with_priors(scans, PriorsFile([priors] if priors else []), AS_IT_SAYS, imu)
        used = [scan.prior for scan in navigated.scans]
        assert words.format(priors) in " ".join(capsys.readouterr().err.split())
        if nav or not imu:
            assert all(prior is None or not prior.knows_attitude for prior in used)
        else:
            assert used == [scan.prior for scan in scans]
            assert all(prior is not None and prior.knows_attitude for prior in used)

    @pytest.mark.parametrize("options", [["--method", "icp"], ["--method", "icp", "--no-imu"]])
    def test_a_method_without_priors_ignores_the_imu(self, pair: Path, options: list[str]) -> None:
        shots = [f"{pair / 'dive.sonar'}#{k}" for k in (0, 1)]
        said(sonarmap("register", *shots, *options, "--voxel", "1"), "2 of 2 scans: their own IMU is not used")


ROWS = 100


def table(*changed: tuple[int, str]) -> str:
    """A log at 1 Hz along East; `changed` replaces rows."""
    rows = [
        f"{START + k:.0f},{60 + 1e-7 * (k % 3):.7f},{5 + 2.7e-5 * k:.7f},{90 + k % 2},{12.5},7" for k in range(ROWS)
    ]
    for row, text in changed:
        rows[row] = text
    return "\n".join(["time,lat,lon,hdg,depth (m),pings", *rows, ""])


@pytest.fixture
def log(tmp_path: Path) -> Path:
    path = tmp_path / "nav.csv"
    path.write_text(table((30, f"{START + 30:.0f},60.1,5.0008,91,12.5,7"), (50, f"{START + 50:.0f},,,,,7")))
    return path


def scans(folder: Path, start: float) -> Path:
    folder.mkdir()
    for k in range(3):
        points = np.random.default_rng(k).normal(size=(50, 3)).astype(np.float32)
        np.savez(folder / f"s{k}.npz", points=points, stamp=start + 5.0 * k)
    return folder


def test_a_log_as_json(log: Path) -> None:
    found = printed(sonarmap("inspect", log, "--json"))
    assert (found["rows"], found["clock"]["rate_hz"], found["clock"]["gaps"]) == (ROWS, pytest.approx(1.0), 0)
    assert found["clock"]["start_utc"] == "2026-07-01 09:30:00"
    assert set(found["columns"]) == {"heading_deg", "x_m", "y_m", "depth_m"}
    assert found["columns"]["depth_m"] == {"rows": ROWS - 1, "least": 12.5, "median": 12.5, "most": 12.5}
    assert found["columns"]["x_m"]["rows"] == ROWS - 2
    assert found["speed_mps"]["median"] == pytest.approx(1.5, rel=0.02)
    (fault,) = found["left_out"]
    assert (fault["line"], fault["kind"]) == (32, "position")
    assert found["scans"] is None
    assert any("not used: the columns 'pings'" in note for note in found["notes"])


def test_a_log_in_words(log: Path) -> None:
    result = done(sonarmap("inspect", log))
    words = " ".join(result.stdout.split())
    for phrase in ("nav.csv", "100 rows", "1 rows per second, no gaps", "line 32: position: far from the rows around"):
        assert phrase in words


def test_a_log_and_scans(log: Path, tmp_path: Path) -> None:
    found = printed(sonarmap("inspect", log, scans(tmp_path / "with", START + 10), "--json"))
    assert found["scans"] == {
        "count": 3,
        "covered": dict.fromkeys(("heading_deg", "x_m", "y_m", "depth_m"), 3),
        "apart": "",
    }
    result = sonarmap("inspect", log, scans(tmp_path / "hour", START + 3610))
    assert result.exit_code == 3
    said(result, "no row is at the time of a scan", "wanted stamps of one clock")


def test_clouds_in_csv_are_scans_and_invalid_logs_are_refused(log: Path, tmp_path: Path) -> None:
    cloud = tmp_path / "cloud.csv"
    points = np.random.default_rng(0).normal(size=(50, 4)).round(3)
    cloud.write_text("x,y,z,time\n" + "\n".join(",".join(map(str, row)) for row in points.tolist()) + "\n")
    assert printed(sonarmap("inspect", cloud, "--json"))["scans"] == 1
    refused(sonarmap("inspect", cloud, "--nav-offset", "1"), "--nav-offset", "log of navigation")
    bad = tmp_path / "bad.csv"
    bad.write_text(table((7, f"{START + 7:.0f},sixty,5,90,12,7")))
    refused(sonarmap("inspect", bad), "bad.csv: line 9", "sixty")
    nmea = tmp_path / "ship.nmea"
    nmea.write_text("$GPGGA,093000.00,6000.0000,N,00500.0000,E,1,08,1.0,0.0,M,,M,,*5B\n")
    assert sonarmap("inspect", nmea).exit_code == 2  # its times have no date


def test_a_sonar_that_hangs_is_named_by_inspect_and_map(tmp_path: Path) -> None:
    names = [f"scan_{k}" for k in range(7)]
    inputs = write(tmp_path, **{name: scan(min(k, 3)) for k, name in enumerate(names)})
    words = "3 of 7 scans repeat an earlier one point for point, the first scan_4"
    assert any(note.startswith(words) for note in as_json(*inputs)["notes"])
    said(sonarmap("map", *inputs, "-o", tmp_path / "out", "--grid", "64", "--no-report"), words)
    warnings = json.loads((tmp_path / "out" / "summary.json").read_text())["warnings"]
    assert any(warning.startswith(words) for warning in warnings)
