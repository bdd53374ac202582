"""`--method` end to end: methods other than the spectral one, in the same verbs."""

import json
import sys
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform

from sonarmap.tools.lab.evaluate.trajectory import pair_error
from sonarmap.tools.methods.registry import METHODS
from tests.samples.clutter_scans import (
    T_WORLD_SENSOR,
    printed,
    refused,
    sonarmap,
)

VOXEL = ("--voxel", "0.4")
CONTRACT = {"T_target_source", "covariance", "accepted", "psr", "overlap", "seconds", "reason"}


@pytest.fixture(autouse=True)
def _no_device(monkeypatch: pytest.MonkeyPatch) -> None:
    """Fail if an OpenCL device is chosen: these methods need none."""

    def never(*_: object) -> None:
        raise AssertionError("a device was chosen")

    monkeypatch.setattr("sonarmap.kernels.device.device.choose_device", never)


@pytest.mark.parametrize("method", ["icp", "icp-plane"])
def test_register_prints_the_result_as_json(pair: list[str], method: str) -> None:
    result = sonarmap("register", *pair, "--method", method, *VOXEL, "--json")
    found, truth = printed(result), T_WORLD_SENSOR[0].inv() * T_WORLD_SENSOR[1]
    assert result.stderr == ""
    assert found.keys() >= CONTRACT
    assert pair_error(RigidTransform.from_matrix(found["T_target_source"]), truth).within(1.0, 0.4)
    assert (found["method"], found["accepted"], found["psr"], found["grid"]) == (method, True, None, None)
    assert found["voxel"] == 0.4
    assert 0 < found["overlap"] <= 1
    assert np.linalg.eigvalsh(found["covariance"]).min() > 0


def test_the_voxel_size_follows_from_grid_as_for_the_spectral_method(pair: list[str]) -> None:
    """A cube of 128 voxels, or of --grid voxels, along each edge holds the scan with a margin."""
    coarse, fine = (
        json.loads(sonarmap("register", *pair, "--method", "icp", *grid, "--json").stdout)["voxel"]
        for grid in (("--grid", "32"), ())
    )
    assert coarse == pytest.approx(4 * fine)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ("--method hemisphere --set hypotheses=12", ["there is no 'hypotheses'; choose from max_tilt"]),
        (
            "--method icp --max-tilt 35 --device cpu",
            ["no effect with --method icp: --device and --max-tilt; leave out", "spectral or hemisphere"],
        ),
        ("--method icp --grid 64 --voxel 0.4", ["no effect with --method icp: --grid; leave out"]),
        ("--method ipc", ["no method is called 'ipc'", *METHODS]),
    ],
)
@pytest.mark.parametrize("verb", ["register", "map"])
def test_unused_option_is_refused(pair: list[str], tmp_path: Path, verb: str, arguments: str, words: list[str]) -> None:
    out = ("-o", tmp_path / "out") if verb == "map" else ()
    refused(sonarmap(verb, *pair, *out, *arguments.split()), *words)


def test_missing_package_is_named(pair: list[str], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "kiss_matcher", None)
    result = sonarmap("register", *pair, "--method", "kiss", *VOXEL, "--json")
    refused(result, "the method kiss needs the package kiss-matcher", "pip install 'sonarmap[peers]'")
