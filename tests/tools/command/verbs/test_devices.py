"""`sonarmap devices`: the list, the one that would be chosen, and none at all."""

import json
from pathlib import Path

import pytest
from typer.testing import CliRunner

from sonarmap.kernels.device.device import Device, choose_device, list_devices
from sonarmap.kernels.device.verdict import Verdict, remember_verdict
from sonarmap.kernels.errors import DeviceError
from sonarmap.tools.command.main import app
from tests.samples.command_line import sonarmap


class TestDevices:
    def test_the_table_marks_the_chosen_one(self, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setenv("PYOPENCL_CTX", "")
        device = choose_device()
        result = CliRunner().invoke(app, ["devices"])
        assert result.exit_code == 0
        marked = [line for line in result.stdout.splitlines() if "→" in line]
        assert len(marked) == 1
        assert device.name in marked[0]
        below = result.stdout.splitlines()[result.stdout.splitlines().index(marked[0]) + 1 :]
        assert device.cl_device.platform.name in below[0]
        assert below[1].rstrip().endswith("; works")

    def test_json(self, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setenv("PYOPENCL_CTX", "")
        device = choose_device()
        shown = sonarmap("devices", "--json", PYOPENCL_CTX="")
        assert (shown.returncode, shown.stderr) == (0, "")
        listed = json.loads(shown.stdout)
        chosen = next(entry for entry in listed["devices"] if entry["selector"] == listed["chosen"])
        assert chosen["name"] == device.name
        assert chosen["works"]
        assert chosen["memory"] >= chosen["largest_allocation"] > 0

    def test_each_that_works_is_tested(self, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
        monkeypatch.setenv("PYOPENCL_CTX", "")
        monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
        monkeypatch.setattr("sonarmap.kernels.device.verdict._known", {})
        before = json.loads(CliRunner().invoke(app, ["devices", "--json"]).stdout)["devices"]
        assert {entry["self_test"] for entry in before if entry["kind"] == "cpu"} == {"not tested"}
        result = CliRunner().invoke(app, ["devices", "--test"])
        assert result.exit_code == 0
        working = [line for line in result.stdout.splitlines() if line.rstrip().endswith("; works")]
        assert working
        assert all("passed" in line for line in working)
        after = json.loads(CliRunner().invoke(app, ["devices", "--json"]).stdout)["devices"]
        assert [entry["self_test"] == "passed" for entry in after] == [entry["works"] for entry in after]

    def test_one_that_fails_its_test_is_refused(self, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
        monkeypatch.setenv("PYOPENCL_CTX", "")
        monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
        monkeypatch.setattr("sonarmap.kernels.device.verdict._known", {})
        for info in list_devices():
            remember_verdict(info.identity, Verdict("failed", "voxels of points: off by 1 voxels"))
        result = CliRunner().invoke(app, ["devices"])
        assert result.exit_code == 2
        table, said = " ".join(result.stdout.split()), " ".join(result.stderr.split())
        assert "self-test failed; does not work: its self-test failed: voxels of points: off by 1 voxels" in table
        assert "its self-test failed: voxels of points" in said
        assert "update the driver and try it again by 'sonarmap devices --test'" in said

    def test_an_unknown_device_is_2(self) -> None:
        result = CliRunner().invoke(app, ["devices", "--device", "abacus"])
        assert result.exit_code == 2
        assert "no OpenCL device matches 'abacus'" in result.stderr

    def test_no_driver_names_the_package_that_brings_one(self, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
        monkeypatch.setenv("OCL_ICD_VENDORS", str(tmp_path))
        result = CliRunner().invoke(app, ["devices"])
        assert result.exit_code == 2
        assert "pocl-opencl-icd" in result.stderr

    def test_devices_that_all_fail_are_listed_and_2(self, monkeypatch: pytest.MonkeyPatch) -> None:
        def no_device(selector: str | None = None) -> Device:
            raise DeviceError("no OpenCL device works")

        monkeypatch.setattr("sonarmap.kernels.device.device.choose_device", no_device)
        result = CliRunner().invoke(app, ["devices", "--json"])
        assert result.exit_code == 2
        listed = json.loads(result.stdout)
        assert listed["chosen"] is None
        assert listed["devices"]
        assert "no OpenCL device works" in result.stderr
