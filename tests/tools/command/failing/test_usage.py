"""Usage errors of typer, failures as JSON with --json, and --quiet."""

import json
from pathlib import Path

import pytest
from typer.testing import Result

from tests.samples.clutter_scans import refused, refused_with_reason, said, scan, sonarmap, write


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("maps a", "No such command 'maps'. Did you mean 'map'?"),
        ("map a.ply -o x --gird 3", "No such option: --gird (Possible options: --grid)"),
        ("map", "Missing argument 'INPUT...'"),
        ("devices --json=3", "Option '--json' does not take a value"),
        ("map a.ply -o x --grid many", "valid integer, unable to parse string as an integer, not 'many'"),
        ("map a.ply --out=", "is empty; give a name, or . for the current folder"),
        ("record --out=", "is empty; give a name, or . for the current folder"),
    ],
)
def test_usage_errors_say_what_was_given_and_what_to_do(line: str, message: str) -> None:
    result = sonarmap(*line.split())
    assert (result.exit_code, result.stdout) == (2, "")
    shown = " ".join(result.stderr.split())
    assert shown.startswith("error: ")
    assert message in shown
    assert shown.endswith("--help` shows how it is called.")
    assert "╭" not in shown


def test_without_a_verb_the_help_is_printed() -> None:
    result = sonarmap()
    assert result.exit_code == 2
    assert "Usage: sonarmap" in result.output
    assert "error" not in result.stderr


GRID = ("--grid", "64")


@pytest.fixture(scope="module")
def scans(tmp_path_factory: pytest.TempPathFactory) -> list[str]:
    return write(tmp_path_factory.mktemp("scans"), a=scan(0), b=scan(1), c=scan(2, scene=2))


def failure(result: Result) -> dict[str, object]:
    printed = json.loads(result.stdout)
    assert set(printed) == {"error", "exit_code"}
    assert printed["exit_code"] == result.exit_code
    return printed


class TestJson:
    @pytest.mark.parametrize(
        ("arguments", "words"),
        [
            ("map missing.ply -o out --json", "no such file or folder: missing.ply"),
            ("map x -o out --grid 98 --json", "try --grid 96 or --grid 100"),
            ("map x --json --out", "Option '--out' requires an argument"),
            ("fly --json", "No such command 'fly'"),
        ],
    )
    def test_refusals_are_printed_as_json(self, arguments: str, words: str) -> None:
        result = sonarmap(*arguments.split())
        assert words in str(failure(result)["error"])
        refused(result, words)

    @pytest.mark.parametrize(("error", "code"), [(ZeroDivisionError("by zero"), 1), (KeyboardInterrupt(), 130)])
    def test_a_defect_and_ctrl_c_are_printed_as_json(
        self, error: BaseException, code: int, scans: list[str], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
    ) -> None:
        def fail(*_: object, **__: object) -> None:
            raise error

        monkeypatch.setattr("sonarmap.slam.mapper.Mapper.run", fail)
        result = sonarmap("map", *scans, "-o", tmp_path, *GRID, "--json")
        assert result.exit_code == code
        words = str(failure(result)["error"])
        assert ("stopped: no pair was done yet" in words) == (code == 130)
        said(result, words)

    def test_a_long_message_is_shortened(self) -> None:
        """Even if it quotes much of a damaged file or of the command line."""
        result = sonarmap("map", "x" * 100_000, "-o", "out", "--json")
        message = str(failure(result)["error"])
        assert len(message) < 3100
        assert "x [... 1" in message
        assert message.endswith("Check the path and its permissions")
        said(result, message)


class TestQuiet:
    @pytest.mark.slow
    def test_quiet_prints_only_warnings_and_errors(self, scans: list[str], tmp_path: Path) -> None:
        result = sonarmap("map", *scans[:2], "-o", tmp_path, *GRID, "--quiet")
        assert (result.exit_code, result.stdout, result.stderr) == (0, "", "")
        again = sonarmap("map", *reversed(scans), "-o", tmp_path, *GRID, "--quiet")
        assert (again.exit_code, again.stdout) == (3, "")
        assert all(line.startswith("warning: ") for line in again.stderr.splitlines())
        assert "c" in again.stderr
        refused = sonarmap("map", "missing.ply", "-o", tmp_path, "--quiet")
        assert refused.stderr.startswith("error: ")


CALLS = [
    ("register", "PATH.ply", "SCAN"),
    ("map", "FOLDER", "-o", "PATH"),
    *(("map", "FOLDER", "-o", "OUT", option, "PATH") for option in ("--priors", "--odometry", "--ties", "--control")),
    ("live", "PATH", "-o", "OUT"),
    ("record", "-o", "PATH.sonar"),
    ("inspect", "SCAN", "--template", "PATH/a.csv"),
    ("view", "PATH"),
    ("locate", "PATH", "SCAN"),
    ("compare", "PATH", "PATH", "-o", "OUT"),
    ("optimize", "PATH.g2o", "-o", "OUT"),
    ("simulate", "--scene", "pool", "--scans", "2", "-o", "PATH"),
    ("evaluate", "PATH", "PATH"),
    ("--config", "PATH", "devices"),
]


@pytest.mark.parametrize("call", CALLS, ids=" ".join)
@pytest.mark.parametrize("name", ["n" * 300, "gone"], ids=["long", "gone"])
def test_a_path_that_the_system_refuses_is_an_input_error(
    tmp_path: Path, call: tuple[str, ...], name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "scans").mkdir()
    paths = {"SCAN": write(tmp_path / "scans", a=scan(0), b=scan(1))[0], "FOLDER": str(tmp_path / "scans")}
    paths |= {"OUT": str(tmp_path / "out"), "PATH": name}
    here = tmp_path / "here"
    here.mkdir()
    monkeypatch.chdir(here)
    if name == "gone":
        here.rmdir()
    words = [paths.get(word, word.replace("PATH", name)) for word in call]
    refused_with_reason(sonarmap(*words))
