"""Registrars kept between calls of `sonarmap.register` give the results of new ones without being built twice."""

from collections import deque
from typing import Any

import numpy as np
import pytest

import sonarmap
from sonarmap.spectral.grid import Grid
from sonarmap.spectral.hemisphere import HemisphereRegistrar
from sonarmap.spectral.registration import SpectralRegistrar
from sonarmap.tools.methods import registry as reuse
from sonarmap.tools.methods.registry import Setup
from tests.samples.scenes.reliefs import above, relief, seen

HERE, THERE = above(0, 0, 12), above(3, -2, 13, 25, 4, -7)


@pytest.fixture(autouse=True)
def _nothing_kept(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(reuse, "_KEPT", deque(maxlen=1))


def counting(name: str, call: Any, calls: list[str]) -> Any:
    def counted(*given: Any) -> Any:
        calls.append(name)
        return call(*given)

    return counted


@pytest.fixture
def calls(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Names of the registrars' calls, in order."""
    made: list[str] = []
    for kind in (SpectralRegistrar, HemisphereRegistrar):
        for name in ("__init__", "register"):
            monkeypatch.setattr(kind, name, counting(name, getattr(kind, name), made))
    return made


def pair(scale: float = 1.0) -> tuple[np.ndarray, np.ndarray]:
    target, source = (scale * seen(relief(1, 6000), pose) for pose in (HERE, THERE))
    return target, source


def matrix(scale: float = 1.0, **options: Any) -> np.ndarray:
    return sonarmap.register(*pair(scale), edge=32, **options).T_target_source.as_matrix()


@pytest.mark.parametrize("method", ["spectral", "hemisphere"])
def test_a_registrar_is_built_once_and_each_call_registers_once(calls: list[str], method: str) -> None:
    """Also for scans of another size with other voxels; the results equal those of a new registrar."""
    first, other, again = (matrix(scale, method=method) for scale in (1.0, 1.7, 1.0))
    assert calls == ["__init__", "register", "register", "register"]
    np.testing.assert_array_equal(first, again)
    fresh = sonarmap.register(*sonarmap.prepare(pair(1.7), edge=32, method=method))
    np.testing.assert_array_equal(fresh.T_target_source.as_matrix(), other)


@pytest.mark.slow
def test_other_settings_replace_the_kept_registrar(calls: list[str], monkeypatch: pytest.MonkeyPatch) -> None:
    several: list[Any] = [{}, {"max_tilt": 0.5}, {"max_tilt": 0.5, "seed": 3}, {"method": "hemisphere"}, {}]
    for options in several:
        matrix(**options)
        assert len(reuse._KEPT) == 1
    assert calls.count("__init__") == 5
    matrix(method="icp")
    assert not reuse._KEPT  # points alone: quickly built, so not kept
    monkeypatch.setattr(reuse, "_PART", 10**9)  # as if the device were too small
    matrix()
    assert not reuse._KEPT


def test_prepared_scans_have_their_own_registrar(calls: list[str]) -> None:
    matrix()
    prepared = [sonarmap.prepare(pair(), edge=32) for _ in range(2)]
    assert calls.count("__init__") == 3
    assert prepared[0][0].registrar is not prepared[1][0].registrar


def test_after_an_error_no_registrar_is_kept(calls: list[str]) -> None:
    flat = np.zeros((500, 3)) + np.arange(500)[:, None] * np.array([0.1, 0.0, 0.0])
    matrix()
    with pytest.raises(sonarmap.InputError):
        sonarmap.register(flat, flat, edge=32)
    assert not reuse._KEPT
    np.testing.assert_array_equal(matrix(), matrix())


def test_concurrent_calls_do_not_share_a_registrar() -> None:
    """As from two threads: a registrar in use is not available."""
    setup = Setup(Grid(32, 1.0))
    with reuse.reused("spectral", setup) as first, reuse.reused("spectral", setup) as second:
        assert first is not second
