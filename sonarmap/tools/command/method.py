"""The registration method that the shared options describe, configured for the scans."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from sonarmap.kernels.errors import InputError
from sonarmap.tools.command.options.registration import DEFAULT_EDGE, MethodOptions, changed
from sonarmap.tools.command.terminal import say
from sonarmap.tools.methods.registry import METHODS, Setup, find_method

if TYPE_CHECKING:
    from sonarmap.kernels.device.device import Device
    from sonarmap.spectral.grid import Grid
    from sonarmap.spectral.hemisphere import HemisphereConfig
    from sonarmap.spectral.registration import SpectralConfig
    from sonarmap.spectral.result import Registrar
    from sonarmap.spectral.scan import Scan


@dataclass(frozen=True, slots=True)
class ConfiguredMethod:
    """A method that is ready to register."""

    name: str  # a key of METHODS
    registrar: "Registrar"  # the method itself
    grid: "Grid"  # shared by the scans; a method that is not spectral uses only its voxel
    setup: Setup  # what the registrar was made from
    # config, device: of a method that runs on a device; None for others
    config: "SpectralConfig | HemisphereConfig | None" = None
    device: "Device | None" = None
    seed: int | None = None  # of a method that uses random numbers; None for others

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


def require_effect(options: MethodOptions, priors: bool) -> None:
    """Refuse options that make no difference to the method, and name the methods that use them; `priors`: whether there
    is a file of them. Raises InputError."""
    given = options.given | ({"priors"} if priors else set())
    always = {"voxel"} if "voxel" in given else {"voxel", "grid"}  # without a voxel the edge says how large one is
    if idle := sorted(given - find_method(options.method).options - always):
        flags = " and ".join(f"--{name.replace('_', '-')}" for name in idle)
        verb, pronoun = ("has", "it") if len(idle) == 1 else ("have", "them")
        condition = " and --voxel" if idle == ["grid"] else ""
        users = [name for name, entry in METHODS.items() if set(idle) <= entry.options | always]
        instead = f", or use --method {' or '.join(users)}" if users else ""
        raise InputError(
            f"{flags} {verb} no effect with --method {options.method}{condition}; leave {pronoun} out{instead}"
        )


def require_method(options: MethodOptions) -> None:
    """Look at the method, the grid and the device before scans are read, or come.

    Raises InputError, DeviceError: one of them cannot be used.
    """
    from sonarmap.kernels.device.device import choose_device
    from sonarmap.spectral.grid import Grid
    from sonarmap.tools.files.memory import require_program

    require_program()
    method = find_method(options.method)
    if "device" in method.options:
        _config_changes(options)
        _require_memory(choose_device(options.device), options.grid or DEFAULT_EDGE)
    else:
        method.make(Setup(Grid(16, 1.0)))


def configure_method(scans: "Sequence[Scan]", options: MethodOptions, survey: bool = False) -> ConfiguredMethod:
    """The method on the grid that the options ask for, or that suits the scans; on that of a `survey` if more scans may
    be added to them later.

    Raises InputError, DeviceError: the method, the grid, the scans or the device cannot be used.
    """
    from sonarmap.slam.survey_grid import survey_grid
    from sonarmap.spectral.grid import choose_grid
    from sonarmap.spectral.hemisphere import HemisphereRegistrar
    from sonarmap.spectral.registration import SpectralRegistrar
    from sonarmap.tools.files.memory import require_program

    require_program()
    changes = _config_changes(options)
    if changes.get("use_strength"):
        _require_strength(scans)
    grid = (survey_grid if survey else choose_grid)(scans, options.grid or DEFAULT_EDGE, options.voxel)
    method = find_method(options.method)
    setup = Setup(grid, options.device, options.seed or 0, changes)
    registrar = method.make(setup)
    if isinstance(registrar, SpectralRegistrar | HemisphereRegistrar):
        _require_memory(registrar.device, grid.edge)
        for note in registrar.device.notes:
            say(note)
        return ConfiguredMethod(options.method, registrar, grid, setup, registrar.config, registrar.device)
    seed = setup.seed if "seed" in method.options else None
    return ConfiguredMethod(options.method, registrar, grid, setup, seed=seed)


def _require_memory(device: "Device", edge: int) -> None:
    """Refuse a grid that does not fit beside other programs, where the device has the machine's memory."""
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
    from sonarmap.spectral.hemisphere import HemisphereConfig
    from sonarmap.spectral.registration import SpectralConfig

    usual = HemisphereConfig() if options.method == "hemisphere" else SpectralConfig()
    config = changed(usual, options.settings)
    changes = {name: getattr(config, name) for name in (text.partition("=")[0] for text in options.settings)}
    return changes | ({} if options.max_tilt is None else {"max_tilt": math.radians(options.max_tilt)})


def _require_strength(scans: "Sequence[Scan]") -> None:
    bare = [scan.name for scan in scans if scan.strength is None]
    if len(bare) == len(scans):
        raise InputError(
            "--set use_strength=true: no scan has echo strengths. Leave it out, or give files with a column intensity "
            "or strength."
        )
    if bare:
        say(f"{len(bare)} of {len(scans)} scans have no echo strength; only their shape is used: {bare[0]} ...")
