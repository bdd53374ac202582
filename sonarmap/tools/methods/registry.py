"""The registration methods by name. A new method is a function that builds it and a row of METHODS.

The last method is kept between registrations, as computing its tables takes longer than registering a pair.
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

if TYPE_CHECKING:  # the help of the command line names the methods and has to start fast
    from sonarmap.spectral.grid import Grid
    from sonarmap.spectral.result import Registrar

DEFAULT_METHOD = "spectral"

_HEMISPHERE = frozenset(("grid", "max_tilt", "set", "device"))
_SPECTRAL = _HEMISPHERE | {"priors"}
_SEEDED = frozenset(("seed",))

# Code that affects the results of methods, as `places` of `tools.methods.fingerprint.source_digest`
_DEVICE_SOURCES = ("kernels", "spectral")
_POINT_SOURCES = tuple(f"tools/lab/baselines/{name}.py" for name in ("points", "icp"))
_FEATURE_SOURCES = (*_POINT_SOURCES, "tools/lab/baselines/features.py")
ALL_METHODS = (*_DEVICE_SOURCES, "tools/lab/baselines", "tools/methods/registry.py")


@dataclass(frozen=True, slots=True)
class Setup:
    """Everything that a method is built from; a method ignores fields that do not apply to it."""

    grid: Grid  # shared by the scans; methods that work on points thin them to one point per voxel
    device: str | None = None  # selector for `choose_device`, used by the spectral methods
    seed: int = 0  # used by the methods that draw random samples
    # fields of SpectralConfig or HemisphereConfig with values other than the defaults
    changes: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class Method:
    """A method of registration."""

    title: str  # one phrase for the help
    make: Callable[[Setup], Registrar]  # builds the registrar
    sources: tuple[str, ...]  # folders and files whose code affects its results
    # parameter names of the command-line options that change its results, apart from the voxel
    options: frozenset[str] = frozenset()
    package: str = ""  # optional package that pip has to install; "" for none


def build(name: str, grid: Grid, device: str | None = None, seed: int = 0) -> Registrar:
    """A method with its default settings; `device` and `seed` as in `Setup`.

    Raises:
        InputError: the method is unknown, or the package that it needs is not installed.
        DeviceError: the device does not exist or is too small.
    """
    return find_method(name).make(Setup(grid, device, seed))


def find_method(name: str) -> Method:
    """The method of this name. Raises InputError: the method is unknown."""
    if name not in METHODS:
        raise InputError(f"no method is called {name!r}; wanted one of {', '.join(METHODS)}")
    return METHODS[name]


def is_installed(name: str) -> bool:
    """Whether the package that a method needs is installed; true for a method that needs none."""
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
    """Builds a method from another library."""

    # its class in `tools.lab.baselines`, as "module:Class"; imported late, as the laboratory imports this module
    registrar: str
    kind: str = ""  # first argument of a class with several methods; "" for a class with one
    seeded: bool = False  # whether it draws random samples

    def __call__(self, setup: Setup) -> Registrar:
        load_package("open3d", "open3d", "this method", "lab")
        module, _, name = self.registrar.partition(":")
        arguments = [*filter(None, [self.kind]), *([setup.seed] if self.seeded else [])]
        return getattr(import_module(f"sonarmap.tools.lab.baselines.{module}"), name)(setup.grid.voxel, *arguments)


# Name, as given to --method -> method
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
        "gicp": Method(
            "generalized ICP from the identity (small_gicp)",
            _OfLab("icp:GicpRegistrar"),
            _POINT_SOURCES,
            package="small-gicp",
        ),
        "fpfh-ransac": Method(
            "FPFH features, RANSAC, then ICP (Open3D)",
            _OfLab("features:FeatureRegistrar", seeded=True),
            _FEATURE_SOURCES,
            _SEEDED,
        ),
        "kiss": Method(
            "KISS-Matcher, then ICP", _OfLab("features:KissRegistrar"), _FEATURE_SOURCES, package="kiss-matcher"
        ),
    }
)

# A method is kept if a pair needs at most 1 / _PART of the device's memory: larger grids gain little by reuse.
_PART = 32
_CHOOSE = ("PYOPENCL_CTX", "SONARMAP_FLAVOR")  # environment variables that affect the choice of the device
# Key and registrar of the last method. Its `pop` and `append` are atomic, so that threads never share a registrar.
_KEPT: deque[tuple[object, Any]] = deque(maxlen=1)


@contextmanager
def reused(name: str, setup: Setup) -> Generator[Registrar]:
    """A method for one `with` block: that of the last block if the setup differs in the voxel at most, else a new one.

    No other thread uses the method during the block. If the block raises an error, the method is not kept.

    Raises:
        InputError, DeviceError: the method cannot be built, as in `build`.
    """
    key = name, setup.grid.edge, setup.device, setup.seed, *setup.changes.items(), *map(os.environ.get, _CHOOSE)
    try:
        last, kept = _KEPT.pop()
    except IndexError:
        last = kept = None
    if kept is not None and last == key:
        registrar = kept.with_voxel(setup.grid.voxel)
    else:
        kept = None  # frees its memory before the next method allocates
        registrar = find_method(name).make(setup)
    yield registrar
    if _is_worth_keeping(registrar, setup.grid.edge):
        _KEPT.append((key, registrar))


def _is_worth_keeping(registrar: Any, edge: int) -> bool:
    if not hasattr(registrar, "with_voxel"):  # quick to build
        return False
    from sonarmap.spectral.memory import memory_plans

    return _PART * max(plan.pair for plan in memory_plans(edge)) <= registrar.device.memory
