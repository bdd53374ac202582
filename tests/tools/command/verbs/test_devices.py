"""`sonarmap devices`: the list, the chosen device, and no usable device."""

import json
from pathlib import Path

import pytest

from sonarmap.kernels.device.device import choose_device, list_devices
from sonarmap.kernels.device.trial import remember_self_test
from tests.samples import command_line
from tests.samples.clutter_scans import done, printed, refused, said, sonarmap


class TestDevices:
    @pytest.fixture(autouse=True)
    def _any_device(self, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
        """No device is requested, and no self-test is remembered."""
        monkeypatch.setenv("PYOPENCL_CTX", "")
        monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))

    @pytest.mark.slow
    def test_json_lists_devices_and_the_chosen_one(self) -> None:
        device = choose_device()
        shown = command_line.sonarmap("devices", "--json", PYOPENCL_CTX="")
        assert (shown.returncode, shown.stderr) == (0, "")
        listed = json.loads(shown.stdout)
        chosen = next(entry for entry in listed["devices"] if entry["selector"] == listed["chosen"])
        assert chosen["name"] == device.name
        assert chosen["works"]
        assert chosen["memory"] >= chosen["largest_allocation"] > 0

    @pytest.mark.slow
    def test_every_working_device_is_tested(self) -> None:
        before = printed(sonarmap("devices", "--json"))["devices"]
        assert {entry["self_test"] for entry in before if entry["kind"] == "cpu"} == {"not tested"}
        tested = done(sonarmap("devices", "--test")).stdout.splitlines()
        working = [line for line in tested if line.rstrip().endswith("; works")]
        assert working
        assert all("passed" in line for line in working)
        after = printed(sonarmap("devices", "--json"))["devices"]
        assert [entry["self_test"] == "passed" for entry in after] == [entry["works"] for entry in after]

    @pytest.mark.slow
    def test_a_device_that_failed_its_self_test_is_refused(self) -> None:
        for info in list_devices():
            remember_self_test(info.identity, "failed", "voxels of points: off by 1 voxels")
        listed = printed(sonarmap("devices", "--json"), 2)
        assert (listed["chosen"], bool(listed["devices"])) == (None, True)
        result = sonarmap("devices")
        assert result.exit_code == 2
        table = " ".join(result.stdout.split())
        assert "self-test failed; does not work: its self-test failed: voxels of points: off by 1 voxels" in table
        again = "update the driver and try it again by 'sonarmap devices --test'"
        said(result, "its self-test failed: voxels of points", again)

    def test_without_a_driver_a_package_is_suggested(self, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
        monkeypatch.setenv("OCL_ICD_VENDORS", str(tmp_path))
        refused(sonarmap("devices"), "pocl-opencl-icd")
