"""Benchmarks: figures that are what they say, twins that do the kernels' work, and wrong kernels that are caught."""

import json
import multiprocessing
import os
import signal
import subprocess
import sys
import time
from dataclasses import replace

import numpy as np
import pytest
from typer.testing import CliRunner

from sonarmap.kernels.device.device import Device
from sonarmap.kernels.errors import DeviceError
from sonarmap.tools.command.main import app
from sonarmap.tools.files.memory import peak_memory
from sonarmap.tools.lab.bench import twins
from sonarmap.tools.lab.bench.case import Peer
from sonarmap.tools.lab.bench.kernels import CASES, measure_case, measure_kernels, relative_difference
from sonarmap.tools.lab.bench.machine import count_cores
from sonarmap.tools.lab.bench.pairs import measure_pairs, simulate_pairs
from sonarmap.tools.lab.bench.peers import fft_peers
from sonarmap.tools.lab.bench.rates import Rates, Traffic, _kernels, _per_item, measure_rates, summarize_rates
from sonarmap.tools.lab.bench.spectra_cases import magnitude_case, real_forward_case
from sonarmap.tools.lab.bench.stages import PAIR_STAGES
from sonarmap.tools.lab.bench.timing import interleave, summarize
from sonarmap.tools.lab.bench.workload import Workload
from tests.samples.places import ROOT

QUICK = ["bench", "--grid", "16", "--repeats", "2"]


@pytest.fixture(autouse=True)
def _small_arrays(monkeypatch: pytest.MonkeyPatch) -> None:
    """Rates of memory, which take seconds, by arrays that are quickly moved."""
    monkeypatch.setattr("sonarmap.tools.lab.bench.rates._LARGEST", 2**20)


class TestTiming:
    def test_quartiles_of_a_known_list(self) -> None:
        times = summarize([5.0, 1.0, 2.0, 4.0, 3.0])
        assert (times.count, times.least, times.first_quartile, times.median) == (5, 1.0, 2.0, 3.0)
        assert (times.third_quartile, times.most, times.most_over_median) == (4.0, 5.0, pytest.approx(5 / 3))

    def test_calls_take_turns_after_a_warm_up(self) -> None:
        calls: list[str] = []
        others = [lambda: calls.append("b"), lambda: calls.append("c")]
        times = interleave(lambda: calls.append("a"), others, 3, lambda: calls.append("-"))
        assert "".join(calls) == "-abc-abc-abc-abc"
        assert [each.count for each in times] == [3, 3, 3]

    def test_a_slow_twin_is_run_less_often(self, monkeypatch: pytest.MonkeyPatch) -> None:
        calls: list[str] = []
        monkeypatch.setattr("sonarmap.tools.lab.bench.timing.perf_counter", lambda: 1.25 * len(calls))
        first, second = interleave(lambda: None, [lambda: calls.append("b")], 10)
        assert (first.count, first.most) == (10, 0.0)
        assert (second.count, second.least, second.most) == (4, 1.25, 1.25)


class TestKernels:
    @pytest.mark.quick_cases(1)
    @pytest.mark.parametrize("edge", [16, 32])
    def test_every_kernel_is_its_twins_equal(self, device: Device, edge: int) -> None:
        said: list[str] = []
        results = list(measure_kernels(device, [edge], 2, 5, 2, said.append))
        assert len(results) == len(said) == len(CASES)
        assert {result.name: result.error for result in results if not result.right} == {}
        for result in results:
            assert result.edge == edge
            assert result.traffic.moved > 0
            assert result.launches > 0
            assert result.kernel_seconds == {}  # this device notes no times

    def test_a_wrong_kernel_is_told(self, device: Device) -> None:
        case = real_forward_case(Workload(device, 16, 1, 0))
        assert measure_case(case, device, 16, 1).right
        off = replace(case, read=lambda result: case.read(result) * np.float32(1 + 1e-4))
        assert not measure_case(off, device, 16, 1).right
        broken = replace(case, read=lambda result: case.read(result) * np.nan)
        assert not measure_case(broken, device, 16, 1).right
        assert relative_difference(np.ones(3), np.ones(4)) == np.inf


class TestRates:
    def test_the_limit_is_the_sum_of_its_parts(self) -> None:
        """Copying 2 x 300 B at 3 B/s, 80 B in place at 5, and reading 100 B at 7; sizes far below do not count."""
        best = {"copy": {100: 99.0, 400: 3.0}, "in_place": {400: 5.0}, "read": {400: 7.0, 800: 6.0}, "fill": {400: 2.0}}
        rates = Rates(best, 3.0, 1e9)
        assert rates.least_seconds(Traffic(400, 300, 80)) == pytest.approx(600 / 3 + 80 / 5 + 100 / 7)
        assert rates.least_seconds(Traffic(0, 10, 0)) == pytest.approx(10 / 2)
        assert rates.at("copy", 1e9) == 3.0

    def test_a_device_has_all_rates(self, device: Device) -> None:
        rates = summarize_rates(device, [measure_rates(device, 2), measure_rates(device, 1)])
        assert set(rates.best) == {"copy", "in_place", "read", "fill"}
        assert all(min(each.values()) > 1e7 for each in rates.best.values())
        assert 1e7 < rates.copy_rate <= max(rates.best["copy"].values())
        assert rates.flops > 1e8

    def test_a_read_reads_all(self, device: Device) -> None:
        """The kernel's sums, of numbers that are exact in single precision, in an order of their own."""
        numbers = np.random.default_rng(5).integers(0, 50, 2**18).astype(np.float32)
        count = numbers.size // 16 // _per_item(device)
        sums = device.empty((count,))
        _kernels(device)["read"](device.queue, (count,), None, device.to_device(numbers).data, sums.data)
        assert sums.get().sum(dtype=np.float64) == numbers.sum(dtype=np.float64)


class TestPeers:
    def test_fftw_does_what_scipy_does(self, device: Device) -> None:
        pytest.importorskip("pyfftw")
        workload = Workload(device, 32, 2, 3)
        for inverse in (False, True):
            (peer,) = [peer for peer in fft_peers(workload, inverse) if peer.name == "pyfftw"]
            peer.restore()
            peer.run()

    def test_it_takes_its_turn(self, device: Device) -> None:
        calls: list[str] = []
        peer = Peer("another", lambda: calls.append("run"), lambda: calls.append("restore"))
        case = replace(real_forward_case(Workload(device, 16, 1, 0)), peers=lambda: [peer])
        result = measure_case(case, device, 16, 3)
        assert result.peers["another"].count == 3
        assert calls.count("run") == 4
        assert calls[0] == "restore"


class TestPairs:
    @pytest.mark.slow
    def test_two_pairs_in_a_process_of_their_own(self) -> None:
        said: list[str] = []
        pairs = simulate_pairs(2, 3, lambda _: None)
        result = measure_pairs(pairs, 32, None, said.append)
        assert said == ["pair 1 at 32^3", "pair 2 at 32^3"]
        times = result["register_seconds"]
        assert (result["prepare_seconds"]["count"], times["count"]) == (4, 2)
        assert 0 < times["least"] <= times["median"] <= times["most"]
        assert 2**26 < result["peak_memory"] < 2**32
        assert result["device_memory"] == pytest.approx(result["planned_memory"], rel=0.15)
        assert result["first_seconds"] > 0
        stages = {stage["name"]: stage for stage in result["stages"]}
        assert {"prepare", "register", "rotations", "compare", "finish"} <= set(stages) <= set(PAIR_STAGES.values())
        assert (stages["prepare"]["calls"], stages["register"]["calls"]) == (2, 1)
        assert stages["register"]["seconds"] >= sum(stages[name]["own_seconds"] for name in ("rotations", "compare"))
        assert sum(stage["device_seconds"] for stage in result["stages"]) > 0
        assert multiprocessing.active_children() == []

    @pytest.mark.slow
    def test_an_error_to_mend_comes_back_from_there(self) -> None:
        pairs = simulate_pairs(1, 3, lambda _: None)
        with pytest.raises(DeviceError, match="no OpenCL device matches 'abacus'"):
            measure_pairs(pairs, 32, "abacus", lambda _: None)


def test_the_peak_of_memory_never_falls() -> None:
    before = peak_memory()
    np.ones(2**25, np.uint8).sum()
    assert peak_memory() >= before > 2**24


def test_cores_are_those_this_process_may_use() -> None:
    assert 1 <= count_cores() <= 4096


class TestCommand:
    def test_json_is_one_object(self) -> None:
        result = CliRunner().invoke(app, [*QUICK, "--pairs", "0", "--json"])
        assert (result.exit_code, result.stderr) == (0, "")
        printed = json.loads(result.stdout)
        assert len(printed["kernels"]) == len(CASES)
        assert printed["pairs"] == []
        assert printed["copy_rate"] > 1e8
        assert printed["versions"]["numpy"] == np.__version__
        assert len(printed["load_average"]) == 2
        row = next(row for row in printed["kernels"] if row["kernel"] == "RealFFT.forward")
        assert row["right"]
        assert row["rate"] == row["bytes_moved"] / row["device_seconds"]["median"]
        assert row["event_seconds"] > 0
        assert any(each["share_of_limit"] for each in row["passes"])
        assert 0 < row["share_of_limit"] < 1.5
        assert row["ratio"] == pytest.approx(row["twin_seconds"]["median"] / row["device_seconds"]["median"])

    @pytest.mark.slow
    def test_the_table_names_every_kernel(self, device: Device) -> None:
        result = CliRunner().invoke(app, [*QUICK, "--pairs", "0"])
        assert result.exit_code == 0
        assert device.name in result.stdout
        assert "kernels at 16^3" in result.stdout
        # Columns that times of a busy machine make too wide stand below, behind the names again.
        first = result.stdout.partition("\nkernel ")[2].partition("\nkernel ")[0]
        names = [line.split()[0] for line in first.splitlines()[1:] if line[:1].strip()]
        workload = Workload(device, 16, 2, 0)
        assert names == [case(workload).name for case in CASES]
        assert "WRONG" not in result.stdout
        assert f"timing kernels: {len(CASES)} of {len(CASES)}" in result.stderr

    def test_a_wrong_kernel_ends_with_3(self, monkeypatch: pytest.MonkeyPatch) -> None:
        right = twins.magnitude
        monkeypatch.setattr("sonarmap.tools.lab.bench.twins.magnitude", lambda *given: right(*given) + np.float32(1))
        for module in ("run", "kernels"):
            monkeypatch.setattr(f"sonarmap.tools.lab.bench.{module}.CASES", (magnitude_case,))
        result = CliRunner().invoke(app, [*QUICK, "--pairs", "0"])
        assert result.exit_code == 3
        assert "WRONG" in result.stdout
        assert "error: the result differs from NumPy's or SciPy's: magnitude at 16^3" in result.stderr

    @pytest.mark.slow
    def test_an_interruption_ends_the_spawned_process_and_is_told_once(self) -> None:
        program = "from sonarmap.tools.command.main import run; run()"
        bench = subprocess.Popen(
            [sys.executable, "-c", program, "bench", "--no-kernels", "--grid", "128", "--pairs", "8"],
            cwd=ROOT,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            start_new_session=True,
        )
        assert bench.stderr
        assert bench.stdout
        while "simulating pairs: 8 of 8" not in bench.stderr.readline():
            assert bench.poll() is None
        time.sleep(2)
        os.killpg(bench.pid, signal.SIGINT)  # as a terminal does: parent and child alike
        # the pipes end when nobody holds them any more, the child neither
        assert bench.stdout.read() == ""
        assert bench.stderr.read().endswith("stopped: nothing was written\n")
        assert bench.wait() == 130


def test_the_workload_depends_on_the_seed_alone(device: Device) -> None:
    first, again, other = (Workload(device, 16, 1, seed) for seed in (1, 1, 2))
    np.testing.assert_array_equal(first.points, again.points)
    np.testing.assert_array_equal(first.volume, again.volume)
    assert not np.array_equal(first.volume, other.volume)
