"""Fingerprints of methods and of their sources, and the specification that workers get."""

import pickle
from dataclasses import replace
from pathlib import Path

import pytest

from sonarmap.kernels.device.device import Device
from sonarmap.spectral.grid import Grid
from sonarmap.tools.lab.baselines.icp import IcpRegistrar
from sonarmap.tools.methods.fingerprint import (
    method_key,
    method_sources,
    source_digest,
    worker_spec,
)
from sonarmap.tools.methods.registry import METHODS, Setup, find_method

SETUP = Setup(Grid(32, 0.5))


def key(name: str, setup: Setup = SETUP) -> str:
    return method_key(name, setup, find_method(name).make(setup))


class TestMethodKey:
    def test_the_key_depends_on_the_settings(self, device: Device) -> None:
        setups = [SETUP, replace(SETUP, grid=Grid(32, 0.4)), replace(SETUP, changes={"hypotheses": 5})]
        assert len({key("spectral", setup) for setup in setups} | {key("icp"), key("hemisphere")}) == 5
        assert key("spectral", replace(SETUP, changes={"hypotheses": 4})) == key("spectral")  # the default

    def test_the_key_depends_on_the_seed_of_random_methods_only(self) -> None:
        seeded = replace(SETUP, seed=4)
        assert key("icp", seeded) == key("icp")
        assert key("fpfh-ransac", seeded) != key("fpfh-ransac")

    def test_methods_that_differ_only_in_arguments_have_different_sources(self) -> None:
        assert method_sources("icp") != method_sources("icp-plane")


class TestWorkerSpec:
    def test_a_worker_builds_the_same_method(self) -> None:
        spec = pickle.loads(pickle.dumps(worker_spec("icp", SETUP, IcpRegistrar(0.5), 3)))
        assert isinstance(spec.make(), IcpRegistrar)
        assert (spec.key, spec.prepared) == (key("icp"), 3)


class TestSources:
    @pytest.fixture
    def project(self, tmp_path: Path) -> Path:
        for name in ("kernels/fft.cl", "kernels/fft.py", "tools/one.py", "tools/notes.md"):
            (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
            (tmp_path / name).write_text("x = 1\n")
        return tmp_path

    @pytest.mark.parametrize(
        "name",
        [
            "kernels/fft.cl",
            "kernels/new.cl",
            "kernels/fitted.json",
            "tools/one.py",
            "tools/notes.md",
        ],
    )
    def test_the_digest_covers_programs(self, project: Path, name: str) -> None:
        def digest() -> str:
            source_digest.cache_clear()
            return source_digest(("kernels", "tools"), project)

        before = digest()
        assert digest() == before
        (project / name).write_text("x = 2\n")
        assert (digest() == before) is (name == "tools/notes.md")

    def test_a_missing_source_is_an_error(self, project: Path) -> None:
        with pytest.raises(FileNotFoundError, match="tools/two"):
            source_digest(("tools/two",), project)

    def test_every_method_has_its_own_sources_only(self) -> None:
        for name, method in METHODS.items():
            assert source_digest(method.sources)
            assert ("kernels" in method.sources) is ("device" in method.options)
            if name in ("icp", "icp-plane"):
                assert not any("features" in place for place in method.sources), name
