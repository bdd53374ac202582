"""From the options that verbs share to a method of registration."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import typer

from kernels.errors import InputError
from tools.cli.options import (
    DEFAULT_EDGE,
    DEFAULT_HYPOTHESES,
    DEFAULT_MAX_TILT,
    DEFAULT_REFINEMENT,
    DEFAULT_SEED,
    DEFAULT_YAW_PEAKS,
)
from tools.cli.terminal import say
from tools.methods.registry import DEFAULT_METHOD, METHODS, Setup, find_method

if TYPE_CHECKING:
    from kernels.opencl.device import Device
    from spectral.grid import Grid
    from spectral.hemisphere.registration import HemisphereConfig
    from spectral.registration import SpectralConfig
    from spectral.result import Registrar
    from spectral.scan import Scan


@dataclass(frozen=True, slots=True)
class Method:
    """How to register, as the options say it.

    Attributes:
        name: a key of METHODS.
        grid: voxels per edge; None for 128.
        voxel: edge of a voxel [m]; None for the one in which the largest scan fits.
        max_tilt: largest roll and pitch between two scans [deg].
        hypotheses: how many rotations are followed.
        refine: what makes the answer finer than voxels, "icp" or "spectral".
        yaw_peaks: how many yaw peaks are followed.
        strength: whether voxels are weighed by their echo strength.
        device: as `choose_device` takes it.
        seed: of the methods that draw at random.
        priors: a CSV file of what else is known of the scans' poses.
        given: the options that the user gave, by the names of METHODS' `hears`.
    """

    name: str = DEFAULT_METHOD
    grid: int | None = None
    voxel: float | None = None
    max_tilt: float = DEFAULT_MAX_TILT
    hypotheses: int = DEFAULT_HYPOTHESES
    refine: str = DEFAULT_REFINEMENT
    yaw_peaks: int = DEFAULT_YAW_PEAKS
    strength: bool = False
    device: str | None = None
    seed: int = DEFAULT_SEED
    priors: Path | None = None
    given: frozenset[str] = frozenset()


@dataclass(frozen=True, slots=True)
class Chosen:
    """A method that is ready to register.

    Attributes:
        name: a key of METHODS.
        registrar: the method.
        grid: that the scans share; what is no spectral method knows its voxel alone.
        setup: what the registrar was made from.
        config, device: of a method that runs on a device; None for others.
        seed: of a method that draws at random; None for others.
    """

    name: str
    registrar: "Registrar"
    grid: "Grid"
    setup: Setup
    config: "SpectralConfig | HemisphereConfig | None" = None
    device: "Device | None" = None
    seed: int | None = None

    @property
    def edge(self) -> int | None:
        """Voxels per edge of the grid; None where the method has none."""
        return self.grid.edge if self.config else None

    @property
    def settings(self) -> Mapping[str, Any]:
        """What a summary tells of it."""
        seeded = {} if self.seed is None else {"seed": self.seed}
        grid = {"edge": self.edge, "voxel": self.grid.voxel}
        return {"method": self.name, "grid": grid, "spectral": self.config, **seeded}


def method_of(context: typer.Context) -> Method:
    """The method that a verb's options ask for.

    Raises:
        InputError: options that the method does not hear.
    """
    options = context.params
    names = [name for name in Method.__dataclass_fields__ if name not in ("name", "given")]
    given = {name for name in names if (source := context.get_parameter_source(name)) and source.name == "COMMANDLINE"}
    method = Method(options["method"], given=frozenset(given), **{name: options[name] for name in names})
    _refuse_unheard(method)
    return method


def build_registrar(scans: "Sequence[Scan]", method: Method) -> Chosen:
    """The method on the grid that was asked for or that suits the scans.

    Raises:
        InputError, DeviceError: the method, the grid, the scans or the device will not do.
    """
    from spectral.grid import choose_grid
    from spectral.hemisphere.registration import HemisphereRegistrar
    from spectral.registration import SpectralRegistrar

    if method.strength:
        _look_for_strength(scans)
    grid = choose_grid(scans, method.grid or DEFAULT_EDGE, method.voxel)
    found = find_method(method.name)
    setup = Setup(grid, method.device, method.seed, _changes(method))
    registrar = found.make(setup)
    if isinstance(registrar, SpectralRegistrar | HemisphereRegistrar):
        for note in registrar.device.notes:
            say(note)
        return Chosen(method.name, registrar, grid, setup, registrar.config, registrar.device)
    return Chosen(method.name, registrar, grid, setup, seed=method.seed if "seed" in found.hears else None)


def _changes(method: Method) -> dict[str, Any]:
    """What the user's own options change in a spectral method's configuration."""
    values = {
        "max_tilt": ("max_tilt", float(np.deg2rad(method.max_tilt))),
        "hypotheses": ("hypotheses", method.hypotheses),
        "refine": ("refinement", method.refine),
        "yaw_peaks": ("yaw_peaks", method.yaw_peaks),
        "strength": ("use_strength", method.strength),
    }
    return dict(values[option] for option in sorted(method.given & values.keys()))


def _refuse_unheard(method: Method) -> None:
    """Refuse options that would make no difference.

    Raises:
        InputError: naming them and the methods that hear them.
    """
    hears = find_method(method.name).hears
    # without a voxel the grid's edge decides how large one is, whatever the method
    always = {"voxel"} if "voxel" in method.given else {"voxel", "grid"}
    unheard = sorted(method.given - hears - always)
    if not unheard:
        return
    flags = [f"--{name.replace('_', '-')}" for name in unheard]
    others = [name for name, other in METHODS.items() if set(unheard) <= other.hears | always]
    instead = f", or use --method {' or '.join(others)}" if others else ""
    beside = " beside --voxel" if unheard == ["grid"] else ""
    raise InputError(f"--method {method.name} does not hear {' and '.join(flags)}{beside}; drop it{instead}")


def _look_for_strength(scans: "Sequence[Scan]") -> None:
    bare = [scan.name for scan in scans if scan.strength is None]
    if len(bare) == len(scans):
        raise InputError(
            "--strength: no scan holds echo strengths. Leave it out, or give files with a column intensity or strength."
        )
    if bare:
        say(
            f"{len(bare)} of {len(scans)} scans hold no echo strength and are taken by their shape alone: {bare[0]} ..."
        )
