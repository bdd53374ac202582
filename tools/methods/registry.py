"""Every method of registration by its name: the one place that knows them all. A new one is a row of METHODS."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

from kernels.errors import InputError

if TYPE_CHECKING:  # the command line names the methods in its help, which is to come at once
    from spectral.grid import Grid
    from spectral.result import Registrar

DEFAULT_METHOD = "spectral"

_ON_DEVICE = frozenset(("grid", "max_tilt", "strength", "device"))
_SPECTRAL = _ON_DEVICE | {"hypotheses", "refine", "priors"}
_HEMISPHERE = _ON_DEVICE | {"yaw_peaks"}
_SEEDED = frozenset(("seed",))


@dataclass(frozen=True, slots=True)
class Setup:
    """What a method is built from; each takes of it what it knows.

    Attributes:
        grid: that the scans share. Methods that work on points thin them to one per voxel of its size.
        device: of the spectral methods, as `choose_device` takes it.
        seed: of the methods that draw at random.
        changes: of the SpectralConfig or HemisphereConfig of these, field by field.
    """

    grid: Grid
    device: str | None = None
    seed: int = 0
    changes: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class Method:
    """One way to register.

    Attributes:
        title: what it is, in words.
        make: the registrar.
        hears: the options that mean something to it, by their parameters' names, beside the voxel.
        package: what pip has to install beyond sonarmap's own; "" for nothing.
    """

    title: str
    make: Callable[[Setup], Registrar]
    hears: frozenset[str] = frozenset()
    package: str = ""


def build(name: str, grid: Grid, device: str | None = None, seed: int = 0) -> Registrar:
    """A method with its defaults: what experiments compare.

    Args:
        name: a key of METHODS.
        grid: that the scans share.
        device: of the spectral methods, as `choose_device` takes it; the others choose none.
        seed: of the methods that draw at random.

    Raises:
        InputError: there is no such method, or the package that it wants is not installed.
        DeviceError: there is no such device, or it is too small.
    """
    return find_method(name).make(Setup(grid, device, seed))


def find_method(name: str) -> Method:
    """The method of this name.

    Raises:
        InputError: there is none.
    """
    if name not in METHODS:
        raise InputError(f"no method is called {name!r}; wanted one of {', '.join(METHODS)}")
    return METHODS[name]


def _spectral(setup: Setup) -> Registrar:
    from kernels.opencl.device import choose_device
    from spectral.registration import SpectralConfig, SpectralRegistrar

    return SpectralRegistrar(choose_device(setup.device), setup.grid, SpectralConfig(**setup.changes))


def _hemisphere(setup: Setup) -> Registrar:
    from kernels.opencl.device import choose_device
    from spectral.hemisphere.registration import HemisphereConfig, HemisphereRegistrar

    config = replace(HemisphereConfig.paper(), **setup.changes)
    return HemisphereRegistrar(choose_device(setup.device), setup.grid, config)


def _planes(setup: Setup) -> Registrar:
    from tools.baselines.planes.registrar import PlaneRegistrar

    return PlaneRegistrar(voxel=setup.grid.voxel)


def _icp(setup: Setup) -> Registrar:
    from tools.baselines.icp import IcpRegistrar

    return IcpRegistrar(setup.grid.voxel)


def _icp_plane(setup: Setup) -> Registrar:
    from tools.baselines.icp import IcpRegistrar

    return IcpRegistrar(setup.grid.voxel, "plane")


def _fpfh_ransac(setup: Setup) -> Registrar:
    from tools.baselines.features import FeatureRegistrar

    return FeatureRegistrar(setup.grid.voxel, "ransac", setup.seed)


def _fpfh_fgr(setup: Setup) -> Registrar:
    from tools.baselines.features import FeatureRegistrar

    return FeatureRegistrar(setup.grid.voxel, "fgr", setup.seed)


def _kiss(setup: Setup) -> Registrar:
    from tools.baselines.kiss import KissRegistrar

    return KissRegistrar(setup.grid.voxel)


def _gicp(setup: Setup) -> Registrar:
    from tools.baselines.gicp import GicpRegistrar

    return GicpRegistrar(setup.grid.voxel)


# Name, as --method takes it -> method
METHODS: Mapping[str, Method] = MappingProxyType(
    {
        DEFAULT_METHOD: Method("rotations from all of SO(3), verified by what the scans saw", _spectral, _SPECTRAL),
        "hemisphere": Method("the paper's chain: one yaw peak, no refinement", _hemisphere, _HEMISPHERE),
        "planes": Method("plane patches, matched (Pathak et al. 2010)", _planes),
        "icp": Method("ICP point to point from the identity (Open3D)", _icp),
        "icp-plane": Method("ICP point to plane from the identity (Open3D)", _icp_plane),
        "fpfh-ransac": Method("FPFH features, RANSAC, then ICP (Open3D)", _fpfh_ransac, _SEEDED),
        "fpfh-fgr": Method("FPFH features, fast global registration, then ICP (Open3D)", _fpfh_fgr, _SEEDED),
        "kiss": Method("KISS-Matcher, then ICP", _kiss, package="kiss-matcher"),
        "gicp": Method("generalized ICP from the identity (small_gicp)", _gicp, package="small_gicp"),
    }
)
