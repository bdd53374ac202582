"""What a worker makes its registrar from, and the key of what its results depend on."""

import pickle
from dataclasses import replace

import pytest

import tools.methods.key
from kernels.errors import InputError
from kernels.opencl.device import Device
from spectral.grid import Grid
from tools.baselines.planes.registrar import PlaneRegistrar
from tools.methods.key import checked_recipe, method_key, recipe
from tools.methods.registry import Setup, find_method

SETUP = Setup(Grid(32, 0.5))


def key(name: str, setup: Setup = SETUP) -> str:
    return method_key(name, setup, find_method(name).make(setup))


def test_a_worker_makes_what_this_process_has() -> None:
    for make in (recipe, checked_recipe):
        told = pickle.loads(pickle.dumps(make("planes", SETUP, PlaneRegistrar(0.5), 3)))
        assert isinstance(told.make(), PlaneRegistrar)
        assert (told.key, told.prepared) == (key("planes"), 3)


def test_settings_decide(device: Device) -> None:
    setups = [SETUP, replace(SETUP, grid=Grid(32, 0.4)), replace(SETUP, changes={"hypotheses": 5})]
    assert len({key("spectral", setup) for setup in setups} | {key("planes"), key("hemisphere")}) == 5
    assert key("spectral", replace(SETUP, changes={"hypotheses": 12})) == key("spectral")  # the default


def test_a_seed_decides_where_it_is_heard() -> None:
    seeded = replace(SETUP, seed=4)
    assert key("planes", seeded) == key("planes")
    assert key("fpfh-ransac", seeded) != key("fpfh-ransac")


@pytest.mark.parametrize("what", ["_sources", "package_versions"])
def test_code_and_versions_decide_and_a_worker_with_others_refuses(monkeypatch: pytest.MonkeyPatch, what: str) -> None:
    before = key("planes")
    told = checked_recipe("planes", SETUP, PlaneRegistrar(0.5), 3)
    monkeypatch.setattr(tools.methods.key, what, lambda *_: {"numpy": "0.1"})
    assert key("planes") != before
    with pytest.raises(InputError, match=r"a worker of the cluster would not find .* Install the same there"):
        told.make()
