"""The registration method that the shared options describe, configured for the scans."""

import math
from collections.abc import Mapping, Sequence, Set
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from sonarmap.kernels.errors import InputError
from sonarmap.tools.command.options.registration import (
    DEFAULT_EDGE,
    DEFAULT_HYPOTHESES,
    DEFAULT_MAX_TILT,
    DEFAULT_REFINEMENT,
    DEFAULT_SEED,
    DEFAULT_YAW_PEAKS,
)
from sonarmap.tools.command.terminal import say
from sonarmap.tools.methods.registry import DEFAULT_METHOD, METHODS, Setup, find_method

_GIVEN = ("COMMANDLINE", "DEFAULT_MAP")  # by the user, the second in a file of settings

if TYPE_CHECKING:
    from sonarmap.kernels.device.device import Device
    from sonarmap.spectral.grid import Grid
    from sonarmap.spectral.hemisphere.registration import HemisphereConfig
    from sonarmap.spectral.registration import SpectralConfig
    from sonarmap.spectral.result import Registrar
    from sonarmap.spectral.scan import Scan


@dataclass(frozen=True, slots=True)
class MethodOptions:
    """How to register, as the options say.

    Attributes:
        name: a key of METHODS.
        grid: voxels per edge; None for the default, 128.
        voxel: edge of a voxel [m]; None for the one in which the largest scan fits.
        max_tilt: largest roll and pitch between two scans [deg].
        hypotheses: how many rotations to try.
        refine: how to refine the result below the voxel size, "icp" or "spectral".
        yaw_peaks: how many yaw peaks to try.
        strength: whether voxels are weighted by their echo strength.
        device: as `choose_device` takes it.
        seed: for methods that use random numbers.
        priors: a CSV file of measurements of the scans' poses.
        given: the options that the user gave, by their parameters' names.
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

    @property
    def uses_priors(self) -> bool:
        """Whether the method uses what instruments measured of the poses."""
        return "priors" in find_method(self.name).options


# of the verbs, beside --method
_PARAMETERS = [name for name in MethodOptions.__dataclass_fields__ if name not in ("name", "given")]


@dataclass(frozen=True, slots=True)
class ConfiguredMethod:
    """A method that is ready to register.

    Attributes:
        name: a key of METHODS.
        registrar: the method itself.
        grid: shared by the scans; a method that is not spectral uses only its voxel.
        setup: what the registrar was made from.
        config, device: of a method that runs on a device; None for others.
        seed: of a method that uses random numbers; None for others.
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
        """Voxels per edge of the grid; None for a method without a grid."""
        return self.grid.edge if self.config else None

    @property
    def settings(self) -> Mapping[str, Any]:
        """The method's part of a summary."""
        seed = {} if self.seed is None else {"seed": self.seed}
        grid = {"edge": self.edge, "voxel": self.grid.voxel}
        return {"method": self.name, "grid": grid, "spectral": self.config, **seed}


def method_options(context: typer.Context) -> MethodOptions:
    """The options of the verb that say how to register, as the command line or a file of settings gives them.

    Raises:
        InputError: options that have no effect with the method.
    """
    values = context.params
    names = _PARAMETERS
    given = {name for name in names if (source := context.get_parameter_source(name)) and source.name in _GIVEN}
    options = MethodOptions(values["method"], given=frozenset(given), **{name: values[name] for name in names})
    _refuse_without_effect(options)
    return options


def configure_method(scans: "Sequence[Scan]", options: MethodOptions, survey: bool = False) -> ConfiguredMethod:
    """The method on the grid that the options ask for, or that suits the scans.

    Args:
        scans: that are registered.
        options: of the verb.
        survey: whether more scans may be added to them later, which then keep the grid.

    Raises:
        InputError, DeviceError: the method, the grid, the scans or the device cannot be used.
    """
    from sonarmap.slam.survey_grid import survey_grid
    from sonarmap.spectral.grid import choose_grid
    from sonarmap.spectral.hemisphere.registration import HemisphereRegistrar
    from sonarmap.spectral.registration import SpectralRegistrar
    from sonarmap.tools.files.memory import require_program

    require_program()
    if options.strength:
        _require_strength(scans)
    grid = (survey_grid if survey else choose_grid)(scans, options.grid or DEFAULT_EDGE, options.voxel)
    method = find_method(options.name)
    setup = Setup(grid, options.device, options.seed, _config_changes(options))
    registrar = method.make(setup)
    if isinstance(registrar, SpectralRegistrar | HemisphereRegistrar):
        _require_memory(registrar.device, grid.edge)
        for note in registrar.device.notes:
            say(note)
        return ConfiguredMethod(options.name, registrar, grid, setup, registrar.config, registrar.device)
    seed = options.seed if "seed" in method.options else None
    return ConfiguredMethod(options.name, registrar, grid, setup, seed=seed)


def _require_memory(device: "Device", edge: int) -> None:
    """Refuse a grid that does not fit beside other programs, where the device has the machine's memory.

    Raises:
        InputError: naming a grid that fits.
    """
    if not device.is_cpu:  # its own memory has been looked at
        return
    from sonarmap.kernels.fft.edges import EDGES
    from sonarmap.spectral.memory import memory_plan
    from sonarmap.tools.files.memory import available_memory, require_memory

    available = available_memory()
    fits = max((smaller for smaller in EDGES if memory_plan(smaller).pair <= available), default=0)
    instead = f"use --grid {fits}" if fits else "end other programs"
    require_memory(f"a pair on --grid {edge}", memory_plan(edge).pair, f"{instead}; 'sonarmap doctor' says what fits")


def _config_changes(options: MethodOptions) -> dict[str, Any]:
    """The fields of a spectral method's configuration that the user's options change."""
    values = {
        "max_tilt": ("max_tilt", math.radians(options.max_tilt)),
        "hypotheses": ("hypotheses", options.hypotheses),
        "refine": ("refinement", options.refine),
        "yaw_peaks": ("yaw_peaks", options.yaw_peaks),
        "strength": ("use_strength", options.strength),
    }
    return dict(values[option] for option in sorted(options.given & values.keys()))


def idle_options(method: str, given: Set[str]) -> set[str]:
    """Those of the given options, by their parameters' names, that make no difference to a method."""
    return set(given & set(_PARAMETERS)) - find_method(method).options - _always(given)


def _always(given: Set[str]) -> set[str]:
    """What every method uses: without a voxel the grid's edge decides how large one is."""
    return {"voxel"} if "voxel" in given else {"voxel", "grid"}


def _refuse_without_effect(options: MethodOptions) -> None:
    """Refuse options that would make no difference.

    Raises:
        InputError: naming them, and the methods that use them.
    """
    idle, always = sorted(idle_options(options.name, options.given)), _always(options.given)
    if not idle:
        return
    flags = " and ".join(f"--{name.replace('_', '-')}" for name in idle)
    verb, pronoun = ("has", "it") if len(idle) == 1 else ("have", "them")
    condition = " and --voxel" if idle == ["grid"] else ""
    users = [name for name, method in METHODS.items() if set(idle) <= method.options | always]
    instead = f", or use --method {' or '.join(users)}" if users else ""
    raise InputError(f"{flags} {verb} no effect with --method {options.name}{condition}; leave {pronoun} out{instead}")


def _require_strength(scans: "Sequence[Scan]") -> None:
    bare = [scan.name for scan in scans if scan.strength is None]
    if len(bare) == len(scans):
        raise InputError(
            "--strength: no scan has echo strengths. Leave it out, or give files with a column intensity or strength."
        )
    if bare:
        say(f"{len(bare)} of {len(scans)} scans have no echo strength; only their shape is used: {bare[0]} ...")
