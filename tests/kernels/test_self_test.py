"""The self-test of devices: what it measures, when it runs, and which result is remembered."""

import logging
from collections.abc import Callable
from dataclasses import asdict, replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from sonarmap.kernels import self_test as checks
from sonarmap.kernels.child import Answers
from sonarmap.kernels.device import trial
from sonarmap.kernels.device.device import Device, choose_device, list_devices
from sonarmap.kernels.device.device_info import DeviceInfo, describe
from sonarmap.kernels.device.drivers import loaded_driver
from sonarmap.kernels.device.trial import remember_self_test, self_test, self_test_of
from sonarmap.kernels.errors import DeviceError

Damage = Callable[[Any], Any]


@pytest.fixture(autouse=True)
def _empty_cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    choose_device()
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))


@pytest.fixture
def gpu(device: Device, monkeypatch: pytest.MonkeyPatch) -> DeviceInfo:
    """The processor as a GPU 0:0 and as itself 0:1, tested in this process, where checks can be damaged."""
    driver = loaded_driver()
    assert driver is not None
    processor = replace(describe(device.cl_device, "0:1"), driver_file=driver.file, kind="cpu")
    card = replace(processor, selector="0:0", name="a card", kind="gpu")

    def ask(*given: str, seconds: float) -> Answers:
        steps: list[dict[str, Any]] = [{"found": [asdict(card), asdict(processor)]}]
        for selector in ("0:0", "0:1"):
            steps += [{"begins": selector}, {"tried": [selector, ""]}]
            if given[-1] in (selector, "all"):
                steps.append({"tested": [selector, *self_test(device.cl_device)]})
        return Answers(tuple(steps), "")

    monkeypatch.delenv("PYOPENCL_CTX", raising=False)
    monkeypatch.setattr(trial, "ask", ask)
    monkeypatch.setattr(trial, "installed_drivers", lambda: [driver])
    monkeypatch.setattr("sonarmap.kernels.device.device._loaded", lambda *_: device.cl_device)
    return card


@pytest.fixture
def voxels(monkeypatch: pytest.MonkeyPatch) -> None:
    """Limit the self-test to voxels, since compiling the rest takes many seconds."""
    monkeypatch.setattr(checks, "CHECKS", checks.CHECKS[1:2])


def damage(monkeypatch: pytest.MonkeyPatch, name: str, change: Damage) -> None:
    """Change the result of a function that the checks call."""
    actual = getattr(checks, name)
    monkeypatch.setattr(checks, name, lambda *given, **options: change(actual(*given, **options)))


def with_a_wrong_voxel(volume: Any) -> Any:
    host = volume.get()
    host[tuple(axis[0] for axis in np.nonzero(host))] *= 2
    volume.set(host)
    return volume


def no_measure(_: Device) -> Any:
    raise AssertionError("it was tested again")


@pytest.mark.slow
def test_both_flavors_pass(device: Device) -> None:
    measured = list(checks.measure(device))
    assert len(measured) == 15
    assert not [str(number) for number in measured if not number.passed]
    # tolerances leave a margin of a factor of 2
    assert all(number.off <= number.tolerance / 2 for number in measured)


@pytest.mark.parametrize(
    ("name", "change", "reason"),
    [
        ("find_peaks", lambda _: [], "it finds no peak in a correlation that has several"),
        ("Readback", lambda copy: SimpleNamespace(read=lambda: copy.read() * np.nan), "not finite"),
        ("find_nearest", lambda found: (2 * found[0], found[1]), "distances to a surface: off by"),
        ("fit_planes", lambda rows: 0 * rows, "the rotation of a refinement: off by"),
    ],
)
@pytest.mark.slow
def test_failing_device_is_passed_over(gpu, monkeypatch, name, change, reason):
    damage(monkeypatch, name, change)
    chosen = choose_device()
    assert chosen.selector == "0:1"
    (note,) = chosen.notes
    assert note.startswith("0:0 a card does not work: its self-test failed: ")
    assert reason in note
    assert note.endswith(f"0:1 {chosen.name} is used instead.")


@pytest.mark.slow
def test_slightly_wrong_transform_fails(device: Device, monkeypatch: pytest.MonkeyPatch) -> None:
    """About 500 numbers are wrong by 1 %."""
    forward = checks.RealFFT.forward

    def slightly_wrong(self: checks.RealFFT, volume: Any, out: Any = None) -> Any:
        spectrum = forward(self, volume, out)
        host = spectrum.get()
        host.ravel()[:: host.size // 500] *= 1.01
        spectrum.set(host)
        return spectrum

    monkeypatch.setattr(checks.RealFFT, "forward", slightly_wrong)
    monkeypatch.setattr(checks, "CHECKS", checks.CHECKS[:1])
    state, reason = self_test(device.cl_device)
    assert state == "failed"
    assert "the Fourier transform of 32 x 64 x 128: off by" in reason
    assert "tolerance 2e-06" in reason


@pytest.mark.usefixtures("voxels")
def test_failing_device_is_refused_if_selected(gpu: DeviceInfo, monkeypatch: pytest.MonkeyPatch) -> None:
    damage(monkeypatch, "voxelize", with_a_wrong_voxel)
    with pytest.raises(DeviceError, match=r"'0:0' works\. 0:0 .*off by 1 voxels.*'cpu'.*'sonarmap devices --test'"):
        choose_device("0:0")
    card, processor = list_devices()
    assert (card.self_test, processor.self_test, processor.fault) == ("failed", "not tested", "")
    assert "off by 1 voxels" in card.fault


@pytest.mark.usefixtures("voxels")
def test_gpu_is_tested_once(gpu: DeviceInfo, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level(logging.INFO, "sonarmap")
    assert [info.self_test for info in list_devices()] == ["not tested", "not tested"]
    assert choose_device().selector == "0:0"
    assert "testing a card before it is used for the first time" in caplog.text
    monkeypatch.setattr(checks, "measure", no_measure)
    assert choose_device().selector == "0:0"
    assert choose_device("0:1").selector == "0:1"  # a processor is not tested before use
    assert [info.self_test for info in list_devices()] == ["passed", "not tested"]
    with pytest.raises(AssertionError, match="tested again"):
        list_devices(test=True)


@pytest.mark.parametrize("changed", ["driver", "kernels"])
def test_new_driver_or_kernels_are_tested_again(monkeypatch: pytest.MonkeyPatch, changed: str) -> None:
    card = ("a card", "OpenCL 3.0", "1.0")
    remember_self_test(card, "passed")
    assert self_test_of(card) == ("passed", "")
    if changed == "driver":
        card = ("a card", "OpenCL 3.0", "1.1")
    else:
        monkeypatch.setattr(trial, "kernels_digest", lambda: "of another version")
    assert self_test_of(card) == ("not tested", "")
