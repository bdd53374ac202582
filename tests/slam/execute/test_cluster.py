"""A cluster's workers: scans reach them beside the scheduler, other users notice nothing, certificates are used."""

import os
import signal
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from sonarmap.kernels.errors import InputError
from sonarmap.slam.execute import worker as specs
from sonarmap.slam.execute.cluster import cluster
from sonarmap.slam.execute.executor import Executor
from sonarmap.slam.execute.pair_text import to_text
from sonarmap.slam.execute.runner import Execution, PairRunner
from sonarmap.slam.pair import Candidate
from sonarmap.spectral.scan import Scan
from tests.samples.clusters.counting_proxy import counting_proxy
from tests.samples.clusters.dask_clusters import certificate, local_cluster, port_of, threads_cluster
from tests.samples.clusters.survey_worker import worker_spec
from tests.samples.surveys import ring_poses, scans_of

COUNT = 12
SCANS = scans_of(ring_poses(COUNT))
PAIRS = [(i, i + step) for i in range(COUNT) for step in (1, 2, 5) if i + step < COUNT]


def register(executor: Executor, notes: Path, ending: str = "", scans: Any = SCANS) -> list[str]:
    execution = Execution(worker_spec(COUNT, notes, ending), executor)
    pairs = PairRunner(execution, scans, 0, None).register([Candidate(i, j, "loop") for i, j in PAIRS])
    return [to_text(pair.registration, pair.failure) for pair in pairs]


@pytest.fixture(scope="module")
def expected(tmp_path_factory: pytest.TempPathFactory) -> list[str]:
    from sonarmap.slam.execute.executor import this_process

    return register(this_process(), tmp_path_factory.mktemp("expected") / "notes")


@pytest.fixture(scope="module")
def threads() -> Iterator[Any]:
    with threads_cluster(2) as started:
        yield started


class TestScans:
    @pytest.mark.slow
    def test_those_used_last_stay_on_the_workers(
        self, threads: Any, tmp_path: Path, expected: list[str], monkeypatch: pytest.MonkeyPatch
    ) -> None:
        """Two scans' worth: most are sent again when they are needed again."""
        monkeypatch.setattr("sonarmap.slam.execute.cluster._MOST_HELD", 2 * SCANS[0].points.nbytes)
        with cluster(threads.scheduler_address) as executor:
            assert register(executor, tmp_path / "notes") == expected
            transport: Any = executor.transport
            assert len(transport._held) <= 3

    def test_workers_out_of_reach_get_them_through_the_scheduler(
        self, threads: Any, tmp_path: Path, expected: list[str]
    ) -> None:
        with cluster(threads.scheduler_address) as executor:
            # pyrefly: ignore[missing-attribute]
            client, sent = executor.transport._client, []
            scatter = client.scatter

            def from_behind_a_firewall(scan: object, direct: bool, hash: bool) -> object:
                sent.append(direct)
                if direct:
                    raise OSError("timed out")
                return scatter(scan, direct=False, hash=hash)

            client.scatter = from_behind_a_firewall
            assert register(executor, tmp_path / "notes") == expected
        assert sent.count(True) == 1

    @pytest.mark.slow
    def test_they_do_not_go_through_the_scheduler(self, threads: Any, tmp_path: Path, expected: list[str]) -> None:
        """A pair's own share is a few kilobytes: its job, and its result."""
        rng = np.random.default_rng(1)
        scans = [replace(scan, points=rng.normal(size=(20_000, 3)).astype(np.float32)) for scan in SCANS]
        with counting_proxy(port_of(threads)) as proxy, cluster(f"tcp://127.0.0.1:{proxy.port}") as executor:
            assert register(executor, tmp_path / "notes", scans=scans) == expected
        assert sum(scan.points.nbytes for scan in scans) > 2_000_000
        assert proxy.passed / len(PAIRS) < 10_000


class TestOtherUsers:
    @pytest.mark.slow
    def test_their_work_and_what_they_keep_on_workers_stays(
        self, threads: Any, tmp_path: Path, expected: list[str]
    ) -> None:
        distributed = pytest.importorskip("distributed")
        with distributed.Client(threads.scheduler_address, set_as_default=False) as other:
            kept, slow = other.scatter(Scan(SCANS[0].points), hash=False), other.submit(_sleeping, 1.0, pure=False)
            workers = other.nthreads()
            with cluster(threads.scheduler_address) as executor:
                assert register(executor, tmp_path / "notes") == expected
            assert np.array_equal(kept.result().points, SCANS[0].points)
            assert slow.result() == "slept"
            assert other.nthreads() == workers
            # the scheduler forgets our scans once it sees that we are gone
            assert _soon(lambda: {key for keys in other.has_what().values() for key in keys} == {kept.key, slow.key})

    @pytest.mark.slow
    def test_a_worker_without_work_frees_its_device(
        self, threads: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        monkeypatch.setattr("sonarmap.slam.execute.worker.IDLE", 2.0)
        with cluster(threads.scheduler_address) as executor:
            register(executor, tmp_path / "notes")
            assert specs._workers
        assert _soon(lambda: not specs._workers)


def _sleeping(seconds: float) -> str:
    time.sleep(seconds)
    return "slept"


def _soon(happens: Callable[[], bool]) -> bool:
    """Whether it happens within a minute."""
    for _ in range(1200):
        if happens():
            return True
        time.sleep(0.05)
    return False


@pytest.mark.slow
class TestKilledWorkers:
    @pytest.mark.parametrize("pair", ["4 9"])
    @pytest.mark.parametrize("nanny", [True, False], ids=["replaced", "gone for good"])
    def test_one_makes_no_difference(self, tmp_path: Path, expected: list[str], pair: str, nanny: bool) -> None:
        with local_cluster(2) as started:
            for worker in started.workers.values():
                worker.auto_restart = nanny
            with cluster(started.scheduler_address) as executor:
                assert register(executor, tmp_path / "notes", f"once {pair}") == expected
        assert (tmp_path / "notes").read_text().splitlines().count(pair) == 2

    def test_a_scheduler_that_ends_is_told(self, tmp_path: Path) -> None:
        started = local_cluster(1)

        def run() -> None:
            with cluster(started.scheduler_address) as executor:
                register(executor, tmp_path / "notes")
                started.close()
                register(executor, tmp_path / "notes")

        with pytest.raises(InputError, match=r"the scheduler at .* was lost\..*continues from there"):
            run()

    def test_killed_again_and_again_between_pairs(self, tmp_path: Path, expected: list[str]) -> None:
        """Whichever worker it is, and whatever scans it holds."""
        rng = np.random.default_rng(3)
        with local_cluster(2) as started, cluster(started.scheduler_address) as executor:
            source = executor.transport.source

            class Killing:
                def source(self, scan: Any, load: Any) -> Any:
                    if rng.random() < 0.1:
                        nanny = started.workers[rng.integers(len(started.workers))]
                        if nanny.pid is not None:
                            os.kill(nanny.pid, signal.SIGKILL)
                    return source(scan, load)

            assert register(replace(executor, transport=Killing()), tmp_path / "notes") == expected


@pytest.fixture(scope="module")
def settings(tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    return certificate(tmp_path_factory.mktemp("certificate"))


class TestCertificates:
    @pytest.fixture
    def encrypted(self, settings: dict[str, str]) -> Iterator[Any]:
        from dask import config

        with config.set(_below_comm(settings)):
            started = threads_cluster(1, protocol="tls", security=pytest.importorskip("distributed").Security())
        with started:
            yield started

    def test_they_are_used(self, encrypted: Any, settings: dict[str, str], tmp_path: Path, expected: list[str]) -> None:
        from dask import config

        assert encrypted.scheduler_address.startswith("tls://")
        encryption = {"distributed.comm.require-encryption": True}
        with config.set(_below_comm(settings) | encryption), cluster(encrypted.scheduler_address) as executor:
            assert register(executor, tmp_path / "notes") == expected

    @pytest.mark.quick_cases(1)
    @pytest.mark.parametrize("given", ["of others", "no tls", "missing file"])
    def test_without_the_right_ones_it_is_told(
        self, given: str, encrypted: Any, settings: dict[str, str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        from dask import config

        monkeypatch.setattr("sonarmap.slam.execute.cluster.PATIENCE", 2.0)
        address = encrypted.scheduler_address
        if given == "no tls":
            address = address.replace("tls://", "tcp://")
        options = {
            "of others": _below_comm(certificate(tmp_path, "elsewhere")),
            "missing file": _below_comm({name: f"{path}.gone" for name, path in settings.items()}),
        }.get(given, {})
        told = pytest.raises(InputError, match=r"takes no connection .*`scheduler=tls://")
        with config.set(options), told, cluster(address):
            pass


def _below_comm(settings: dict[str, str]) -> dict[str, str]:
    return {f"distributed.comm.{name}": value for name, value in settings.items()}
