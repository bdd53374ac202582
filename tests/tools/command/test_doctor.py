"""`sonarmap doctor` on healthy and on broken installations and machines."""

import json
import os
import re
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest

import sonarmap.kernels.child as child
import sonarmap.tools.command.doctor as doctor
from sonarmap.kernels.child import Answers
from sonarmap.tools.command.doctor import Finding, Remedy, lines_of, look_at
from sonarmap.tools.files.memory import available_memory, memory_limits
from tests.samples.clutter_scans import scan, write
from tests.samples.places import ROOT

CHECKS = ["libraries", "OpenCL", "memory", "disk"]
COMMAND = [sys.executable, "-c", "from sonarmap.tools.command.start import start; start()"]


def sonarmap(
    *arguments: str, first: Path | None = None, limit: str = "", variables: Mapping[str, str] | None = None
) -> subprocess.CompletedProcess[str]:
    """Run the command as a subprocess. Modules in the folder `first` come before the installed ones; `limit` holds
    arguments of `ulimit`, as "-v 500000"."""
    search_path = os.pathsep.join([*([str(first)] if first else []), str(ROOT)])
    environment = {**os.environ, "PYTHONPATH": search_path, "COLUMNS": "80", **(variables or {})}
    command = [*COMMAND, *arguments]
    if limit:
        command = ["sh", "-c", f'ulimit {limit}; exec "$@"', "sh", *command]
    return subprocess.run(command, cwd=ROOT, capture_output=True, text=True, env=environment, timeout=400, check=False)


def broken_module(folder: Path, name: str, error: str) -> Path:
    """Add a package whose import raises `error` to a folder, and return the folder."""
    (folder / name).mkdir(parents=True)
    (folder / name / "__init__.py").write_text(f"raise {error}\n")
    return folder


def examined(shown: subprocess.CompletedProcess[str]) -> dict[str, dict[str, Any]]:
    """The checks of `doctor --json` by name."""
    assert "Traceback" not in shown.stderr
    return {check["check"]: check for check in json.loads(shown.stdout)["checks"]}


def quick(**machine: Any) -> dict[str, dict[str, Any]]:
    return examined(sonarmap("doctor", "--json", "--quick", **machine))


def commands_of(check: dict[str, Any]) -> list[str]:
    return [remedy["command"] for remedy in check["remedies"] if remedy["command"]]


class TestHealthy:
    @pytest.mark.slow
    def test_json_of_a_healthy_installation(self) -> None:
        shown = sonarmap("doctor", "--json")
        checks = examined(shown)
        assert (shown.returncode, list(checks)) == (0, CHECKS)
        chosen = checks["OpenCL"]["details"]["chosen"]
        listed = json.loads(sonarmap("devices", "--json").stdout)
        assert chosen == listed["chosen"]
        used = next(device for device in checks["OpenCL"]["details"]["devices"] if device["selector"] == chosen)
        assert used["self_test"] == "passed"
        assert checks["libraries"]["details"]["cannot be loaded"] == {}
        assert checks["memory"]["details"]["largest grid"] >= 16


class TestBroken:
    @pytest.mark.slow
    def test_a_library_that_crashes_is_named_and_the_others_are_checked(self, tmp_path: Path) -> None:
        crash = "SystemExit(__import__('os').kill(__import__('os').getpid(), 11))"
        broken_module(tmp_path, "laspy", crash)
        broken_module(tmp_path, "lazrs", "ImportError('libGL.so.1: cannot open shared object file: No such file')")
        libraries = examined(sonarmap("doctor", "--json", first=tmp_path))["libraries"]
        faults = libraries["details"]["cannot be loaded"]
        assert set(faults) == {"laspy", "lazrs"}
        assert "SIGSEGV" in faults["laspy"]
        assert commands_of(libraries)[0].endswith("--no-deps laspy lazrs")

    @pytest.mark.slow
    @pytest.mark.parametrize("name", ["typer", "lazy_loader", "numpy", "packaging"])
    def test_doctor_runs_without_a_library_of_the_command_line(self, tmp_path: Path, name: str) -> None:
        broken = broken_module(tmp_path, name, f"ModuleNotFoundError('No module named {name}', name={name!r})")
        shown = sonarmap("doctor", "--quick", "--json", first=broken)
        starts = name == "packaging"
        assert (shown.returncode, [*examined(shown)]) == (2, CHECKS if starts else ["command", *CHECKS])
        if not starts:
            assert commands_of(examined(shown)["command"])[0].endswith(f"-m pip install --force-reinstall {name}")
            other = sonarmap("devices", first=broken)
            assert other.returncode == 2
            assert "'sonarmap doctor' says what is missing" in other.stderr

    @pytest.mark.slow
    def test_a_too_old_version_is_reported_with_the_upgrade_command(self, tmp_path: Path) -> None:
        about = tmp_path / "gtsam-1.0.dist-info"
        about.mkdir()
        (about / "METADATA").write_text("Metadata-Version: 2.1\nName: gtsam\nVersion: 1.0\n")
        libraries = quick(first=tmp_path)["libraries"]
        assert libraries["verdict"] == "wrong"
        assert "1.0, wanted gtsam>=" in libraries["seen"]
        assert re.search(r"-m pip install 'gtsam>=[\d.]+'$", commands_of(libraries)[0])

    @pytest.mark.slow
    def test_a_wrong_pyopencl_ctx_is_reported(self) -> None:
        opencl = quick(variables={"PYOPENCL_CTX": "abacus"})["OpenCL"]
        assert opencl["seen"].startswith("no OpenCL device matches 'abacus'")
        assert commands_of(opencl) == ["unset PYOPENCL_CTX"]


DEVICE: dict[str, Any] = {
    "selector": "0:0",
    "name": "a processor",
    "platform": "PoCL",
    "version": "OpenCL 3.0, driver 5.1",
    "kind": "cpu",
    "compute_units": 6,
    "memory": 2**33,
    "driver_file": "/etc/OpenCL/vendors/pocl.icd",
    "fault": "",
    "self_test": "passed",
}
PLAN = {"plan": {"chosen": "0:0", "pairs": [[128, 5]], "largest": 512, "memory": 2**33, "shared": True}}


def opencl(monkeypatch: pytest.MonkeyPatch, *steps: dict[str, Any], end: str = "") -> Finding:
    monkeypatch.setattr(child, "ask", lambda *_, **__: Answers(steps, end))
    return doctor._opencl(test=True)


class TestOpenCL:
    @pytest.mark.parametrize("end", ["it ended with SIGSEGV", f"{child.LATE} 900 s"])
    def test_a_driver_that_crashes_or_hangs_in_a_test_is_wrong(self, monkeypatch: pytest.MonkeyPatch, end: str) -> None:
        finding = opencl(monkeypatch, {"begins": "loading PyOpenCL"}, {"begins": "testing the devices"}, end=end)
        assert (finding.verdict, finding.seen) == ("wrong", f"while testing the devices: {end}")
        assert finding.remedies

    def test_a_driver_that_crashes_at_exit_is_ok(self, monkeypatch: pytest.MonkeyPatch) -> None:
        """Some drivers crash when the process exits, after the device has worked; another cannot be loaded."""
        fault = "libnvidia-opencl.so.1: cannot open shared object file: No such file or directory"
        driver = DEVICE | {"selector": "1", "compute_units": 0, "driver_file": "nvidia.icd", "fault": fault}
        finding = opencl(monkeypatch, {"devices": [DEVICE, driver]}, PLAN, end="it ended with SIGSEGV")
        assert f"1 driver nvidia.icd; does not work: {fault}" in finding.seen
        assert finding.verdict == "ok"
        assert "* 0:0 a processor: cpu, 6 units, 8.0 GiB, PoCL (driver 5.1); self-test passed; works" in finding.seen


class TestMachines:
    def test_a_file_in_place_of_the_folder_is_reported(self, tmp_path: Path) -> None:
        (tmp_path / "out").touch()
        assert look_at(tmp_path / "out" / "map")[1] == f"{tmp_path / 'out'} is a file, not a folder"

    def test_a_folder_without_permission_is_reported(self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        def refuse(path: Path) -> bool:
            raise PermissionError(13, "Permission denied")

        monkeypatch.setattr(Path, "exists", refuse)
        assert look_at(tmp_path) == (0, "permission denied")

    @pytest.mark.slow
    def test_too_little_address_space_is_reported(self, tmp_path: Path) -> None:
        """No driver is tried, as its message would mislead."""
        shown = sonarmap("doctor", "--json", "--quick", limit="-v 500000")
        checks = examined(shown)
        assert (shown.returncode, checks["memory"]["verdict"]) == (2, "wrong")
        assert json.loads(shown.stdout)["verdict"] == "wrong"
        assert "too little for sonarmap" in checks["memory"]["seen"]
        assert checks["OpenCL"]["seen"] == "not tried; see memory"
        scans = write(tmp_path, a=scan(0), b=scan(1))
        made = sonarmap("map", *scans, "--grid", "32", "-o", str(tmp_path / "out"), limit="-v 500000")
        assert made.returncode == 2
        assert "'sonarmap doctor' says" in made.stderr
        assert "Traceback" not in made.stderr

    def test_memory_limits_of_control_groups_count(self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        """Version 2: 1,000 MiB, 700 MiB in use, of which 50 MiB are inactive file cache."""
        group = tmp_path / "a" / "b"
        group.mkdir(parents=True)
        (tmp_path / "own").write_text("0::/a/b\n")
        (group / "memory.max").write_text(f"{1000 << 20}\n")
        (group / "memory.current").write_text(f"{700 << 20}\n")
        (group / "memory.stat").write_text(f"anon 5\ninactive_file {50 << 20}\nactive_file 7\n")
        monkeypatch.setattr("sonarmap.tools.files.memory._GROUPS", tmp_path)
        monkeypatch.setattr("sonarmap.tools.files.memory._OWN_GROUP", tmp_path / "own")
        assert memory_limits()["the control group"] == (1000 << 20, 650 << 20)
        assert available_memory() == 350 << 20
        (group / "memory.max").write_text("max\n")
        assert "the control group" not in memory_limits()


def test_commands_are_printed_unbroken_on_lines_of_their_own() -> None:
    command = "a " * 60 + "b"
    lines = lines_of(Finding("wrong", "one\ntwo", (Remedy("do:", command), Remedy("or this"))))
    assert [line.strip() for line in lines[-4:]] == ["two", "> do:", command, "> or this"]
    assert max(len(line) for line in lines if command not in line) <= 80
