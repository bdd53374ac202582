"""`sonarmap config`, and files of settings in use: what counts, what is said, what is set aside."""

import fcntl
import json
import os
import pty
import re
import struct
import subprocess
import termios
import tomllib
from pathlib import Path
from typing import Any

import pytest

from sonarmap.tools.command.settings.in_force import NAMED_ONLY
from tests.samples.clutter_scans import refused, scan, write
from tests.samples.clutter_scans import sonarmap as run
from tests.samples.command_line import ROOT, SONARMAP
from tests.tools.command.settings.test_setting import SETTINGS


def sets(text: str, name: str = "sonarmap.toml") -> None:
    """Write a file of settings to the current folder."""
    Path(name).write_text(text)


def listed(*arguments: str) -> dict[tuple[str, str], dict[str, Any]]:
    """The rows of `config --json`, by verb and key; a verb's own row counts for more than that of [common]."""
    result = run(*arguments, "config", "--json")
    assert result.exit_code == 0, result.output
    rows = json.loads(result.stdout)["settings"]
    return {(verb, row["key"]): row for row in rows for verb in row["verbs"]}


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The current one, empty."""
    monkeypatch.chdir(tmp_path)
    return tmp_path


class TestConfig:
    def test_every_setting_is_listed(self) -> None:
        rows = listed()
        assert set(rows) == {(entry.verb, entry.key) for entry in SETTINGS}
        assert all(row["source"] == "default" and row["value"] is None for row in rows.values())
        table = run("config").stdout
        assert [entry.key for entry in SETTINGS if not re.search(rf"^ +{entry.key} ", table, re.MULTILINE)] == []

    def test_the_table_fits_80_columns(self) -> None:
        sets("[common]\nmax-tilt = 20\nmagnetic-declination = 2.5\n")
        read, terminal = pty.openpty()
        fcntl.ioctl(terminal, termios.TIOCSWINSZ, struct.pack("HHHH", 50, 80, 0, 0))
        environment = {name: value for name, value in os.environ.items() if name != "COLUMNS"}
        environment |= {"PYTHONPATH": str(ROOT), "TERM": "dumb"}
        with os.fdopen(terminal, "wb") as stdout:
            subprocess.run([*SONARMAP, "config", "map"], stdout=stdout, env=environment, check=True)
        with os.fdopen(read, "rb") as shown:
            lines = shown.read1(1 << 16).decode().splitlines()
        assert max(map(len, lines)) <= 80
        assert any(re.match(r"  magnetic-declination +deg +none +2\.5 +\[common\]", line) for line in lines)

    def test_what_is_in_force_and_from_where(self) -> None:
        sets("[common]\ngrid = 96\nvoxel = 0.5\n[map]\ngrid = 64\nmax-speed = 2\n")
        rows = listed()
        assert (rows["map", "grid"]["value"], rows["map", "grid"]["source"]) == (64, "map")
        assert (rows["inspect", "grid"]["value"], rows["inspect", "grid"]["source"]) == (96, "common")
        assert rows["map", "voxel"]["value"] == 0.5
        assert rows["map", "max-speed"]["value"] == 2
        assert rows["bench", "grid"]["source"] == "default"
        assert re.search(r"max-speed +m/s +learned +2 +\[map\]", run("config", "map").stdout)

    def test_the_file_that_it_prints_is_one(self) -> None:
        text = run("config", "--toml").stdout
        assert tomllib.loads(text) == {section: {} for section in re.findall(r"^\[(.+)\]$", text, re.MULTILINE)}
        lines = re.findall(r"^# ([\w-]+) = ", text, re.MULTILINE)
        assert set(lines) == {entry.key for entry in SETTINGS}
        assert max(map(len, text.splitlines())) <= 120
        sets(text)
        assert listed() == listed("--config", "/dev/null")

    def test_what_is_set_stays_set_in_the_file_that_it_prints(self, folder: Path) -> None:
        common, own = 'grid = 96\nmount = "0,0,180"', 'report = false\nexport = ["pcd", "kitti"]\nvoxel = 0.25'
        sets(f"[common]\n{common}\n[map]\n{own}\n", "a.toml")
        sets(run("--config", "a.toml", "config", "--toml").stdout, "b.toml")
        first, again = listed("--config", "a.toml"), listed("--config", "b.toml")
        assert {key: row["value"] for key, row in first.items()} == {key: row["value"] for key, row in again.items()}
        assert again["map", "export"]["value"] == ["pcd", "kitti"]

    @pytest.mark.parametrize("verb", ["map", "simulate"])
    def test_a_verb_alone(self, verb: str) -> None:
        rows = json.loads(run("config", verb, "--json").stdout)["settings"]
        assert {row["key"] for row in rows} == {entry.key for entry in SETTINGS if entry.verb == verb}

    def test_refusals(self) -> None:
        assert "'mpa' is not a verb; choose one of register, map" in run("config", "mpa").stderr
        assert run("config", "--toml", "--json").exit_code == 2
        refused(run("--config", "gone.toml", "config"), "cannot read the settings gone.toml")


class TestInForce:
    def test_the_command_line_counts_for_more(self, pair: list[str]) -> None:
        sets('[common]\nmethod = "icp"\nvoxel = 0.4\njson = true\n')
        by_file = run("register", *pair)
        assert "settings from sonarmap.toml: method icp, voxel 0.4, json true" in by_file.stderr
        assert (json.loads(by_file.stdout)["method"], json.loads(by_file.stdout)["voxel"]) == ("icp", 0.4)
        given = run("register", *pair, "--voxel", "0.5")
        assert "settings from sonarmap.toml: method icp, json true\n" in given.stderr
        assert json.loads(given.stdout)["voxel"] == 0.5

    def test_another_file_takes_the_place_of_that_in_the_folder(self, folder: Path, pair: list[str]) -> None:
        sets("[common]\ngrid = 97\n")
        sets('[register]\nmethod = "icp"\nvoxel = 0.4\n', "other.toml")
        assert "settings from other.toml" in run("--config", "other.toml", "register", *pair).stderr
        for words in (("--config", "other.toml"), ("--config=other.toml",)):  # wherever it stands
            assert "settings from other.toml" in run("register", *words, *pair).stderr
            assert "settings from other.toml" in run("register", *pair, *words).stderr
        broken = run("register", *pair)
        assert broken.stdout == ""
        refused(broken, "sonarmap.toml: [common] grid is 97: --grid 97 is not an even product")

    def test_what_has_no_effect_is_set_aside_and_named(self, pair: list[str]) -> None:
        """What is written once for all runs does not stop the one that has no use for it."""
        sets(
            "[common]\nvoxel = 0.4\ngrid = 64\nyaw_peaks = 4\nmax-tilt = 20\nmount = '0,0,5'\n"
            "prior-sigmas = '1,1,1,1'\npriors = 'gone.csv'\n"
        )
        result = run("register", *pair, "--method", "icp")
        assert "settings from sonarmap.toml: voxel 0.4; without effect here: grid, " in result.stderr
        assert all(key in result.stderr for key in ("yaw-peaks", "priors", "mount", "prior-sigmas"))
        assert result.exit_code in (0, 3)
        wanted = run("register", *pair, "--method", "icp", "--yaw-peaks", "4")
        refused(wanted, "--yaw-peaks has no effect with --method icp")

    @pytest.mark.parametrize(
        ("text", "line", "words"),
        [
            ("[map]\nworkers = 2\nvoxel = 0.4\nmethod = 'icp'\n",
             "map nowhere -o out --scheduler tcp://127.0.0.1:1", "without effect here: workers; nowhere"),
            ("[map]\nunits = 'yard'\nquiet = true\n",
             "map nowhere -o out", "'yard' is not known; sonarmap.toml: units yard, quiet true"),
            ("[simulate]\nscene = 'harbor'\nseed = 5\n",
             "simulate --like gone.json -o out", "without effect here: scene, seed; gone.json"),
        ],
    )  # fmt: skip
    def test_what_the_command_line_replaces_or_only_the_run_can_refuse(self, text: str, line: str, words: str) -> None:
        sets(text)
        refused(run(*line.split()), *words.split("; "))

    def test_nothing_is_said_where_nothing_is_set(self, pair: list[str]) -> None:
        sets("[simulate]\nscans = 4\n")
        assert "settings" not in run("register", *pair, "--method", "icp", "--voxel", "0.4").stderr

    def test_a_file_that_nobody_named_says_not_where_to_write_or_connect(self, folder: Path, pair: list[str]) -> None:
        """It may have come with somebody's scans, and a scheduler runs what it is sent."""
        settings = "[register]\nmethod = 'icp'\nvoxel = 0.4\nwrite = 'moved.ply'\n"
        sets(settings + "[map]\nscheduler = 'tcp://127.0.0.1:1'\nout = 'map'\n")
        found = run("register", *pair)
        assert found.exit_code in (0, 3)
        assert "warning: sonarmap.toml sets write, which is left out" in found.stderr
        assert "settings from sonarmap.toml: method icp, voxel 0.4\n" in found.stderr
        assert sorted(path.name for path in folder.iterdir()) == ["sonarmap.toml", "source.ply", "target.ply"]
        refused(run("map", *pair), "sets out, scheduler, which", "--out is missing")
        listing = run("config")
        assert "sets out, scheduler, write, which" in listing.stderr
        named = run("--config", "sonarmap.toml", "register", *pair)
        assert "warning: sonarmap.toml sets" not in named.stderr
        assert {"moved.ply"} <= {path.name for path in folder.iterdir()}

    def test_a_file_that_nobody_named_discards_nothing_and_says_not_whom_to_listen_to(self) -> None:
        listening = "multicast = '239.1.1.1:5'\nunicast = '0.0.0.0:5'\ninterface = 'lo'\nsonar = '10.0.0.7'\n"
        sets(f"[record]\n{listening}overwrite = true\n[map]\nfresh = true\n")
        found = run("record", "-o", "a.txt")
        assert "sets interface, multicast, overwrite, sonar, unicast, which is left out" in found.stderr
        assert "settings from" not in found.stderr
        assert "sets fresh, which is left out" in run("map", "nowhere", "-o", "out").stderr
        sets("[live]\nbind = '0.0.0.0'\nnmea = '0.0.0.0:10110'\nport = 8080\n")
        assert "sets bind, nmea, port, which is left out" in run("live", "nowhere", "-o", "out").stderr
        sets("[map]\nfresh = true\n")
        named = run("--config", "sonarmap.toml", "map", "nowhere", "-o", "out")
        assert "settings from sonarmap.toml: fresh true\n" in named.stderr

    def test_long_values_are_shortened(self) -> None:
        values = [f"'{letter * 700}'" for letter in "abcde"]
        keys = ("priors", "mount", "nav-columns", "time-scale", "nav-crs")
        lines = [f"{key} = {value}\n" for key, value in zip(keys, values, strict=True)]
        sets("[map]\nunits = 'yard'\n" + "".join(lines))
        (said,) = [line for line in run("map", "nowhere", "-o", "out").stderr.splitlines() if "settings from" in line]
        assert all(
            f"{key} {letter * 40} [... 620 characters" in said for key, letter in zip(keys, "abcde", strict=True)
        )
        assert "units yard" in said

    def test_a_file_cannot_keep_itself_quiet(self, folder: Path) -> None:
        sets("[optimize]\nquiet = true\nstart = 'given'\n")
        edge = "EDGE_SE3:QUAT 0 1 1 0 0 0 0 0 1 1 0 0 0 0 0 1 0 0 0 0 1 0 0 0 1 0 0 1 0 1"
        (folder / "a.g2o").write_text(f"VERTEX_SE3:QUAT 0 0 0 0 0 0 0 1\nVERTEX_SE3:QUAT 1 1 0 0 0 0 0 1\n{edge}\n")
        words = "settings from sonarmap.toml: start given"
        assert f"{words}, quiet true" in run("optimize", "a.g2o", "-o", "b.g2o").stderr
        assert words in run("optimize", "a.g2o", "-o", "b.g2o", "--quiet").stderr  # nobody named the file
        given = run("--config", "sonarmap.toml", "optimize", "a.g2o", "-o", "b.g2o", "--quiet")
        assert (given.exit_code, words in given.stderr) == (0, False)

    def test_every_path_is_read_or_only_for_a_named_file(self) -> None:
        """A new option that writes belongs to NAMED_ONLY; one that reads belongs here."""
        read = {"priors", "odometry", "ties", "control", "like", "map", "surface", "summary", "compare", "from", "onto"}
        assert {entry.key for entry in SETTINGS if entry.kind is Path} - NAMED_ONLY == read
        network = {entry.key for entry in SETTINGS if re.search("ADDRESS|PORT", entry.parameter.metavar or "")}
        assert {"bind", "port", "nmea", "multicast", "scheduler"} <= network <= NAMED_ONLY
        assert {entry.key for entry in SETTINGS} >= NAMED_ONLY

    @pytest.mark.slow
    def test_a_map_has_the_settings_in_its_summary_and_goes_on(self, folder: Path) -> None:
        files = write(folder / "scans", **{f"s{k}": scan(k) for k in range(3)})
        sets('[map]\nmethod = "icp"\nvoxel = 0.4\nmax-step = 9\nframe = "flu"\nreport = false\n')
        by_file = run("--config", "sonarmap.toml", "map", *files, "-o", "a", "--quiet")
        assert by_file.exit_code in (0, 3), by_file.output
        assert "settings from" not in by_file.stderr  # --quiet
        by_words = run(
            *("--config", "/dev/null", "map", *files, "-o", "b", "--no-report", "--method", "icp", "--voxel", "0.4"),
            *("--max-step", "9", "--frame", "flu", "--quiet"),
        )
        assert by_words.exit_code == by_file.exit_code
        summaries = [json.loads((folder / name / "summary.json").read_text()) for name in "ab"]
        assert summaries[0]["settings"] == summaries[1]["settings"]
        assert summaries[0]["settings"]["mapper"]["limits"]["step"] == 9
        words = ("-o", "a", "--method", "icp", "--voxel", "0.4", "--max-step", "9", "--no-report")
        again = run("--config", "/dev/null", "map", *files, *words)
        assert re.search(r"(\d+) of \1 pairs were in a/journal.sqlite", again.stderr)
