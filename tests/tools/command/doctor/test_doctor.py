"""`sonarmap doctor` on installations that are as they should be, and on broken ones; drivers that crash or hang."""

import json
import re
import subprocess
import tomllib
from pathlib import Path
from typing import Any

import pytest

import sonarmap.tools.command.doctor.opencl as opencl_check
from sonarmap.kernels.child import Answers
from sonarmap.tools.command.doctor.finding import Finding, Remedy, size, worst
from sonarmap.tools.command.doctor.libraries import APT_PACKAGES, EXTRAS
from sonarmap.tools.command.doctor.run import lines_of, summary
from tests.tools.command.doctor.broken import ROOT, broken_module, has_own_loader, sonarmap, without_drivers

CHECKS = ["Python", "libraries", "optional", "OpenCL", "memory", "cores", "disk", "temporary", "caches"]
own_loader = pytest.mark.skipif(not has_own_loader(), reason="PyOpenCL is not from a wheel, which brings a loader")


def examined(shown: subprocess.CompletedProcess[str]) -> dict[str, dict[str, Any]]:
    """The checks of `doctor --json`, by their names."""
    assert "Traceback" not in shown.stderr
    return {check["check"]: check for check in json.loads(shown.stdout)["checks"]}


def quick(**machine: Any) -> dict[str, dict[str, Any]]:
    """The checks of `doctor --quick` on a machine, as broken.sonarmap takes it."""
    return examined(sonarmap("doctor", "--json", "--quick", **machine))


def commands_of(check: dict[str, Any]) -> list[str]:
    return [remedy["command"] for remedy in check["remedies"] if remedy["command"]]


class TestHealthy:
    @pytest.mark.slow
    def test_it_fits_a_screen(self) -> None:
        shown = sonarmap("doctor", "--quick")
        assert (shown.returncode, shown.stderr) == (0, "")
        lines = shown.stdout.splitlines()
        assert len(lines) <= 24
        assert max(map(len, lines)) <= 80
        assert lines[-1].endswith("all that is needed works")
        assert [name for name in CHECKS if not re.search(rf"^ok +{name}\b", shown.stdout, re.MULTILINE)] == []

    @pytest.mark.slow
    def test_json(self) -> None:
        shown = sonarmap("doctor", "--json")
        checks = examined(shown)
        assert (shown.returncode, list(checks)) == (0, CHECKS)
        assert all(check["verdict"] in ("ok", "warning", "wrong") for check in checks.values())
        chosen = checks["OpenCL"]["details"]["chosen"]
        listed = json.loads(sonarmap("devices", "--json").stdout)
        assert chosen == listed["chosen"]
        used = next(device for device in checks["OpenCL"]["details"]["devices"] if device["selector"] == chosen)
        assert used["self_test"] == "passed"
        assert checks["libraries"]["details"]["cannot be loaded"] == {}
        grid = checks["memory"]["details"]["largest grid"]
        assert next(need["pair"] for need in listed["grids"] if need["grid"] == grid) < 2**40


class TestBrokenLibraries:
    @pytest.mark.slow
    def test_opencl_s_loader_is_missing(self, tmp_path: Path) -> None:
        fault = "libOpenCL.so.1: cannot open shared object file: No such file or directory"
        broken = broken_module(tmp_path, "pyopencl", f"ImportError({fault!r})")
        shown = sonarmap("doctor", "--json", first=broken)
        checks = examined(shown)
        assert (shown.returncode, list(checks)) == (2, CHECKS)
        assert checks["OpenCL"]["verdict"] == "wrong"
        assert fault in checks["OpenCL"]["seen"]
        assert commands_of(checks["OpenCL"])[0] == "sudo apt-get install ocl-icd-libopencl1"
        assert "pyopencl" in checks["libraries"]["details"]["cannot be loaded"]

    @pytest.mark.slow
    @own_loader
    def test_the_loader_of_the_wheel_is_missing(self, tmp_path: Path) -> None:
        first = without_drivers(tmp_path, loader=False)
        checks = quick(first=first)
        assert "cannot open shared object file" in checks["OpenCL"]["seen"]
        assert "--force-reinstall --no-deps pyopencl" in commands_of(checks["OpenCL"])[0]
        shown = sonarmap("devices", first=first)
        assert shown.returncode == 2
        assert "a library cannot be loaded" in shown.stderr
        assert "'sonarmap doctor' says what to do" in shown.stderr

    @pytest.mark.slow
    @own_loader
    def test_there_is_no_driver(self, tmp_path: Path) -> None:
        (tmp_path / "empty").mkdir()
        first, vendors = without_drivers(tmp_path / "first"), {"OCL_ICD_VENDORS": str(tmp_path / "empty")}
        shown = sonarmap("doctor", "--json", "--quick", first=first, variables=vendors)
        checks = examined(shown)
        assert shown.returncode == 2
        seen = checks["OpenCL"]["seen"]
        assert f"{tmp_path / 'empty'}, where OCL_ICD_VENDORS points, holds no .icd file" in seen
        assert commands_of(checks["OpenCL"])[:2] == ["unset OCL_ICD_VENDORS", "sudo apt-get install pocl-opencl-icd"]
        shown = sonarmap("devices", first=first, variables=vendors)
        assert shown.returncode == 2
        assert "'sonarmap doctor' says where drivers were looked for" in " ".join(shown.stderr.split())

    @pytest.mark.slow
    def test_a_library_that_ends_the_process_is_blamed_and_the_others_are_tried(self, tmp_path: Path) -> None:
        crash = "SystemExit(__import__('os').kill(__import__('os').getpid(), 11))"
        broken_module(tmp_path, "laspy", crash)
        broken_module(tmp_path, "mcap", "ImportError('libGL.so.1: cannot open shared object file: No such file')")
        checks = examined(sonarmap("doctor", "--json", first=tmp_path))
        faults = checks["libraries"]["details"]["cannot be loaded"]
        assert set(faults) == {"laspy", "mcap"}
        assert "SIGSEGV" in faults["laspy"]
        assert "sudo apt-get install libgl1" in commands_of(checks["libraries"])

    @pytest.mark.slow
    @pytest.mark.parametrize("name", ["typer", "rich", "lazy_loader", "platformdirs", "numpy", "packaging"])
    def test_it_works_without_what_the_command_line_is_made_of(self, tmp_path: Path, name: str) -> None:
        broken = broken_module(tmp_path, name, f"ModuleNotFoundError('No module named {name}', name={name!r})")
        shown = sonarmap("doctor", "--quick", "--json", first=broken)
        starts = name in ("platformdirs", "packaging")
        assert (shown.returncode, [*examined(shown)]) == (2, CHECKS if starts else ["command", *CHECKS])
        if not starts:
            assert commands_of(examined(shown)["command"])[0].endswith(f"-m pip install --force-reinstall {name}")
            other = sonarmap("devices", first=broken)
            assert other.returncode == 2
            assert "'sonarmap doctor' says what is missing" in other.stderr

    @pytest.mark.slow
    def test_a_version_that_is_too_old_is_named_with_the_command(self, tmp_path: Path) -> None:
        about = tmp_path / "gtsam-1.0.dist-info"
        about.mkdir()
        (about / "METADATA").write_text("Metadata-Version: 2.1\nName: gtsam\nVersion: 1.0\n")
        checks = quick(first=tmp_path)
        assert checks["libraries"]["verdict"] == "wrong"
        assert "gtsam 1.0, wanted gtsam>=" in checks["libraries"]["seen"]
        assert re.search(r"-m pip install 'gtsam>=[\d.]+'$", commands_of(checks["libraries"])[0])

    @pytest.mark.slow
    def test_a_library_that_sizes_need_is_not_blamed_on_pyopencl(self, tmp_path: Path) -> None:
        checks = quick(first=broken_module(tmp_path, "scipy", "SystemExit(1)"))
        assert "while choosing a device" in checks["OpenCL"]["seen"]


class TestLists:
    """What doctor knows by heart agrees with where it stands."""

    def test_every_extra_says_what_it_gives(self) -> None:
        project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
        assert set(EXTRAS) == set(project["optional-dependencies"]) - {"dev"}

    def test_the_system_libraries_that_the_setup_installs_are_known(self) -> None:
        installed = dict(re.findall(r'"(lib\S+\.so\.\d+)": "(\S+)"', (ROOT / "tools" / "setup.sh").read_text()))
        assert installed
        assert installed.items() <= APT_PACKAGES.items()


DEVICE: dict[str, Any] = {
    "selector": "0:0",
    "name": "a processor",
    "platform": "PoCL",
    "version": "OpenCL 3.0, driver 5.1",
    "kind": "cpu",
    "compute_units": 6,
    "driver_file": "/etc/OpenCL/vendors/pocl.icd",
    "fault": "",
    "self_test": "passed",
}
USABLE = ({"devices": [DEVICE]}, {"chosen": "0:0"}, {"largest": 512, "pairs": [[128, 5]]})


def judged(monkeypatch: pytest.MonkeyPatch, *steps: dict[str, Any], end: str = "") -> Finding:
    monkeypatch.setattr(opencl_check, "ask", lambda *_, **__: Answers(steps, end))
    return opencl_check.opencl(test=True)[0]


class TestOpenCL:
    def test_a_driver_that_crashes_while_it_is_tested(self, monkeypatch: pytest.MonkeyPatch) -> None:
        steps = {"begins": "loading PyOpenCL"}, {"begins": "testing the devices"}
        finding = judged(monkeypatch, *steps, end="it ended with SIGSEGV")
        assert (finding.verdict, finding.seen) == ("wrong", "while testing the devices: it ended with SIGSEGV")
        assert finding.remedies

    def test_a_driver_that_crashes_when_all_is_done(self, monkeypatch: pytest.MonkeyPatch) -> None:
        """Some do at the end of the process; by then the device has worked."""
        finding = judged(monkeypatch, *USABLE, end="it ended with SIGSEGV")
        assert finding.verdict == "ok"
        assert "0:0 a processor (cpu, 6 units), PoCL 5.1: self-test passed" in finding.seen

    def test_a_second_driver_that_cannot_be_loaded_is_named(self, monkeypatch: pytest.MonkeyPatch) -> None:
        fault = "libnvidia-opencl.so.1: cannot open shared object file: No such file or directory"
        driver = DEVICE | {"selector": "1", "name": "nvidia.icd", "compute_units": 0, "fault": fault}
        finding = judged(monkeypatch, {"devices": [DEVICE, driver]}, *USABLE[1:])
        assert (finding.verdict, f"not used: 1 nvidia.icd: {fault}" in finding.seen) == ("ok", True)

    def test_nothing_where_drivers_are_looked_for(self, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
        monkeypatch.setenv("OCL_ICD_VENDORS", str(tmp_path / "gone"))
        finding = judged(monkeypatch, {"unavailable": "no OpenCL platform was found"})
        assert finding.seen == f"no driver: {tmp_path / 'gone'}, where OCL_ICD_VENDORS points, is not there"
        assert finding.remedies[0].command == "unset OCL_ICD_VENDORS"

    def test_under_a_limit_of_memory_nothing_else_is_blamed(self, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setattr(opencl_check, "memory_is_short", lambda: True)
        finding = judged(monkeypatch, {"unavailable": "no OpenCL platform was found"})
        assert (finding.remedies, finding.seen.endswith("; see memory")) == ((), True)


def test_the_worst_verdict_counts() -> None:
    assert (worst([]), worst(["ok", "warning", "ok"]), worst(["warning", "wrong"])) == ("ok", "warning", "wrong")


class TestWords:
    def test_commands_stand_alone_and_whole(self) -> None:
        command = "a " * 60 + "b"
        lines = lines_of(
            Finding("wrong", "one " * 40 + "\ntwo", (Remedy("do:", command), Remedy("or this")), check="disk"), 80
        )
        assert lines[0].startswith("wrong    disk        one one")
        assert [line.strip() for line in lines[-4:]] == ["two", "> do:", command, "> or this"]
        assert max(len(line) for line in lines if command not in line) <= 80

    def test_sizes(self) -> None:
        sizes = {0: "0 bytes", 1023: "1023 bytes", 65536: "64 KiB", 1.5 * 2**20: "1.5 MiB", 3 * 2**34: "48 GiB"}
        assert {n: size(n) for n in sizes} == sizes

    def test_the_last_line(self) -> None:
        good, bad, doubtful = (Finding(verdict, "") for verdict in ("ok", "wrong", "warning"))
        assert summary([good, good]).endswith("all that is needed works")
        assert summary([good, doubtful]).endswith("all that is needed works; 1 warning")
        assert summary([good, bad, doubtful]).endswith("1 of 3 wrong, and 1 warning; follow the advice after >")
        assert (worst([]), worst(["ok", "warning", "ok"])) == ("ok", "warning")
