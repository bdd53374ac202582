"""Every method of registration by its name. A new one is a function that builds it and a row of METHODS.

The last one stays ready from one registration to the next: to make its tables takes longer than a pair.
"""

from __future__ import annotations

import os
from collections import deque
from collections.abc import Callable, Generator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from importlib import import_module
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

from sonarmap.kernels.errors import InputError
from sonarmap.tools.extras import load_package

if TYPE_CHECKING:  # the command line names the methods in its help, which is to come at once
    from sonarmap.spectral.grid import Grid
    from sonarmap.spectral.result import Registrar

DEFAULT_METHOD = "spectral"

_HEMISPHERE = frozenset(("grid", "max_tilt", "set", "device"))
_SPECTRAL = _HEMISPHERE | {"priors"}
_SEEDED = frozenset(("seed",))

# What decides the results of methods, as `tools.methods.fingerprint.source_digest` takes it
_DEVICE_SOURCES = ("kernels", "spectral")
_POINT_SOURCES = tuple(f"tools/lab/baselines/{name}.py" for name in ("points", "icp"))
_FEATURE_SOURCES = (*_POINT_SOURCES, "tools/lab/baselines/features.py")
ALL_METHODS = (*_DEVICE_SOURCES, "tools/lab/baselines", "tools/methods/registry.py")


@dataclass(frozen=True, slots=True)
class Setup:
    """What a method is built from; each uses the fields that mean something to it."""

    grid: Grid  # which the scans share. Methods that work on points thin them to one per voxel of its size.
    device: str | None = None  # of the spectral methods, as `choose_device` takes it
    seed: int = 0  # of the methods that draw at random
    # fields of the SpectralConfig or HemisphereConfig that are not at their defaults, with their values
    changes: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class Method:
    """A method of registration."""

    title: str  # what it is, in words
    make: Callable[[Setup], Registrar]  # builds the registrar
    sources: tuple[str, ...]  # folders and files whose code decides its results
    # the command line's options that change its results, by their parameters' names, beside the voxel
    options: frozenset[str] = frozenset()
    package: str = ""  # what pip has to install beyond sonarmap's own; "" for nothing


def build(name: str, grid: Grid, device: str | None = None, seed: int = 0) -> Registrar:
    """A method with its defaults, which experiments compare; device and seed as of `Setup`.

    Raises:
        InputError: there is no such method, or the package that it needs is not installed.
        DeviceError: there is no such device, or it is too small.
    """
    return find_method(name).make(Setup(grid, device, seed))


def find_method(name: str) -> Method:
    """The method of this name; InputError where there is none."""
    if name not in METHODS:
        raise InputError(f"no method is called {name!r}; wanted one of {', '.join(METHODS)}")
    return METHODS[name]


def is_installed(name: str) -> bool:
    """Whether the package that a method needs is there; true for a method that needs none."""
    from sonarmap.spectral.grid import Grid

    if not find_method(name).package:
        return True
    try:
        build(name, Grid(16, 1.0))
    except InputError:
        return False
    return True


def _spectral(setup: Setup) -> Registrar:
    from sonarmap.kernels.device.device import choose_device
    from sonarmap.spectral.registration import SpectralConfig, SpectralRegistrar

    return SpectralRegistrar(choose_device(setup.device), setup.grid, SpectralConfig(**setup.changes))


def _hemisphere(setup: Setup) -> Registrar:
    from sonarmap.kernels.device.device import choose_device
    from sonarmap.spectral.hemisphere import HemisphereConfig, HemisphereRegistrar

    return HemisphereRegistrar(choose_device(setup.device), setup.grid, HemisphereConfig(**setup.changes))


@dataclass(frozen=True, slots=True)
class _OfLab:
    """Builds a method that others made."""

    # its class in `tools.lab.baselines`, as "module:Class": the laboratory is built on this list, not the reverse
    registrar: str
    kind: str = ""  # which of the class's methods it is; "" where there is one
    seeded: bool = False  # whether it draws at random

    def __call__(self, setup: Setup) -> Registrar:
        load_package("open3d", "open3d", "this method", "lab")
        module, _, name = self.registrar.partition(":")
        arguments = [*filter(None, [self.kind]), *([setup.seed] if self.seeded else [])]
        return getattr(import_module(f"sonarmap.tools.lab.baselines.{module}"), name)(setup.grid.voxel, *arguments)


# Name, as --method takes it -> method
METHODS: Mapping[str, Method] = MappingProxyType(
    {
        DEFAULT_METHOD: Method(
            "rotations from all of SO(3), verified by what the scans saw", _spectral, _DEVICE_SOURCES, _SPECTRAL
        ),
        "hemisphere": Method("the paper's chain", _hemisphere, _DEVICE_SOURCES, _HEMISPHERE),
        "icp": Method("ICP point to point from the identity (Open3D)", _OfLab("icp:IcpRegistrar"), _POINT_SOURCES),
        "icp-plane": Method(
            "ICP point to plane from the identity (Open3D)", _OfLab("icp:IcpRegistrar", "plane"), _POINT_SOURCES
        ),
        "fpfh-ransac": Method(
            "FPFH features, RANSAC, then ICP (Open3D)",
            _OfLab("features:FeatureRegistrar", "ransac", seeded=True),
            _FEATURE_SOURCES,
            _SEEDED,
        ),
        "fpfh-fgr": Method(
            "FPFH features, fast global registration, then ICP (Open3D)",
            _OfLab("features:FeatureRegistrar", "fgr", seeded=True),
            _FEATURE_SOURCES,
            _SEEDED,
        ),
        "kiss": Method(
            "KISS-Matcher, then ICP", _OfLab("features:KissRegistrar"), _FEATURE_SOURCES, package="kiss-matcher"
        ),
        "gicp": Method(
            "generalized ICP from the identity (small_gicp)",
            _OfLab("icp:GicpRegistrar"),
            _POINT_SOURCES,
            package="small_gicp",
        ),
    }
)

# What is kept takes no more than this part of the device's memory: on larger grids a pair takes far longer.
_PART = 32
_CHOOSE = ("PYOPENCL_CTX", "SONARMAP_FLAVOR")  # what else decides about the device
# The last method and what it was made from; taking it out and putting it back are one step each for all threads.
_KEPT: deque[tuple[object, Any]] = deque(maxlen=1)


@contextmanager
def reused(name: str, setup: Setup) -> Generator[Registrar]:
    """A method as `make` builds it: that of the last block, if nothing but the voxel is another.

    It is the block's alone, also where several threads register at once, and what the block raised leaves none.

    Raises:
        InputError, DeviceError: it cannot be made, as of `build`.
    """
    key = name, setup.grid.edge, setup.device, setup.seed, *setup.changes.items(), *map(os.environ.get, _CHOOSE)
    try:
        last, kept = _KEPT.pop()
    except IndexError:
        last = kept = None
    if kept is not None and last == key:
        registrar = kept.with_voxel(setup.grid.voxel)
    else:
        kept = None  # its memory is free before the next one takes some
        registrar = find_method(name).make(setup)
    yield registrar
    if _is_worth_keeping(registrar, setup.grid.edge):
        _KEPT.append((key, registrar))


def _is_worth_keeping(registrar: Any, edge: int) -> bool:
    if not hasattr(registrar, "with_voxel"):  # made at once
        return False
    from sonarmap.spectral.memory import memory_plans

    return _PART * max(plan.pair for plan in memory_plans(edge)) <= registrar.device.memory
