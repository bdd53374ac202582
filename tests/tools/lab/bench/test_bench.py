"""Benchmarks: timing, kernels, pairs, and stored results."""

import json
import multiprocessing
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner, Result

from sonarmap.kernels.device.device import Device
from sonarmap.tools.command.main import app
from sonarmap.tools.lab.bench.cases import CASES, magnitude_case, real_forward_case
from sonarmap.tools.lab.bench.kernels import measure_kernels
from sonarmap.tools.lab.bench.pairs import measure_pairs, simulate_pairs
from sonarmap.tools.lab.bench.stages import PAIR_STAGES
from sonarmap.tools.lab.bench.timing import interleave


@pytest.fixture(autouse=True, scope="module")
def short_run() -> Iterator[None]:
    """Measure memory rates on small arrays, and only two of the kernels."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("sonarmap.tools.lab.bench.timing.MAX_BYTES", 2**20)
        for module in ("run", "kernels"):
            patch.setattr(f"sonarmap.tools.lab.bench.{module}.CASES", (real_forward_case, magnitude_case))
        yield


def bench(*arguments: str | Path) -> Result:
    return CliRunner().invoke(app, ["bench", *map(str, arguments)])


@pytest.fixture(scope="module")
def stored(short_run: None, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The result of a short run."""
    path = tmp_path_factory.mktemp("bench") / "result.json"
    printed = bench("--grid", "16", "--repeats", "2", "--pairs", "0", "--json", "--out", path)
    assert (printed.exit_code, printed.stderr) == (0, "")
    assert json.loads(printed.stdout) == json.loads(path.read_text())
    return path


class TestTiming:
    def test_calls_take_turns_after_a_warm_up(self) -> None:
        calls: list[str] = []
        turns = [lambda: calls.append("a"), lambda: calls.append("b"), lambda: calls.append("c")]
        times = interleave(turns, 3, lambda: calls.append("-"))
        assert "".join(calls) == "-abc-abc-abc-abc"
        assert [each.count for each in times] == [3, 3, 3]


class TestKernels:
    @pytest.mark.slow
    def test_every_kernel_is_timed(self, device: Device, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setattr("sonarmap.tools.lab.bench.kernels.CASES", CASES)
        results = list(measure_kernels(device, [32], 2, 5, 2, lambda _: None))
        assert len(results) == len(CASES)
        assert all(result["bytes_moved"] > 0 and result["launches"] > 0 for result in results)


@pytest.mark.slow
class TestPairs:
    def test_pairs_are_measured_in_their_own_process(self) -> None:
        result = measure_pairs(simulate_pairs(2, 3, lambda _: None), 32, None, lambda _: None)
        assert (result["prepare_seconds"]["count"], result["register_seconds"]["count"]) == (4, 2)
        assert 0 < result["device_memory"] < result["planned_memory"]  # the plan allows any rotation
        stages = {stage["name"]: stage for stage in result["stages"]}
        assert {"prepare", "register", "rotations", "compare", "finish"} <= set(stages) <= set(PAIR_STAGES.values())
        assert (stages["prepare"]["calls"], stages["register"]["calls"]) == (2, 1)
        assert stages["register"]["seconds"] >= sum(stages[name]["own_seconds"] for name in ("rotations", "compare"))
        assert multiprocessing.active_children() == []


class TestCommand:
    def test_the_result_has_versions_and_rates(self, stored: Path) -> None:
        result = json.loads(stored.read_text())
        assert result["pairs"] == []
        assert result["versions"]["numpy"] == np.__version__
        row = next(row for row in result["kernels"] if row["kernel"] == "RealFFT.forward")
        assert row["rate"] == row["bytes_moved"] / row["device_seconds"]["median"]
        assert row["rate_over_copy_rate"] == row["rate"] / result["copy_rate"]

    @pytest.mark.parametrize(
        ("arguments", "words"),
        [
            (["--grid", "98"], "--grid 98 is not an even product of 2, 3 and 5"),
            (["--no-kernels", "--pairs", "0"], "nothing to measure"),
        ],
    )
    def test_unusable_options_are_refused(self, arguments: list[str], words: str) -> None:
        refused = bench(*arguments)
        assert refused.exit_code == 2
        assert words in " ".join(refused.stderr.split())
