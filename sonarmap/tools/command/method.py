"""Options of registration with their checks, and the registration method that they configure."""

import json
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, fields, is_dataclass, replace
from typing import TYPE_CHECKING, Annotated, Any

from sonarmap.kernels.errors import InputError
from sonarmap.tools.command.option import REGISTRATION, DeviceOption, checked, is_positive, refused_by
from sonarmap.tools.command.terminal import say
from sonarmap.tools.methods.registry import DEFAULT_METHOD, METHODS, Setup, find_method

if TYPE_CHECKING:
    from sonarmap.kernels.device.device import Device
    from sonarmap.spectral.grid import Grid
    from sonarmap.spectral.hemisphere import HemisphereConfig
    from sonarmap.spectral.registration import SpectralConfig
    from sonarmap.spectral.result import Registrar
    from sonarmap.spectral.scan import Scan

DEFAULT_EDGE = 128
DEFAULT_MAX_TILT = 35.0  # [deg], the paper's range of roll and pitch (Sect. 2.7)


def _require_edge(edge: int) -> None:
    from sonarmap.spectral.grid import Grid  # imports SciPy, which the help does not need

    try:
        Grid(edge, 1.0)
    except InputError as error:
        raise InputError(f"{error}, or leave it out for {DEFAULT_EDGE}.") from error


check_tilt = checked(
    lambda tilt: 0 < tilt <= 180,
    "{} degrees; give more than 0 and at most 180 (no limit): how far the vehicle can roll and pitch. Leave it out for "
    f"{DEFAULT_MAX_TILT:g}.",
)
check_seed = checked(
    lambda seed: 0 <= seed < 2**63, "{}; give a whole number from 0 to 2^63 - 1, as in --seed 1."
)  # the seeds that every random generator accepts

GridOption = Annotated[
    int | None,
    REGISTRATION.value(
        "N",
        "Voxels per edge, 16..512: an even product of 2, 3 and 5.",
        callback=refused_by(_require_edge),
        show_default=f"{DEFAULT_EDGE}",
    ),
]
VoxelOption = Annotated[
    float | None,
    REGISTRATION.value(
        "M",
        "Edge of a voxel \\[m].",
        callback=checked(
            is_positive,
            "{} m; give a length above 0, about the size of the noise, as in --voxel 0.5, or leave it out to have it "
            "chosen from the extents of the scans.",
        ),
        show_default="suits the scans",
    ),
]
TiltOption = Annotated[
    float | None,
    REGISTRATION.value(
        "DEG",
        "Largest roll and pitch between two scans \\[deg]; larger ones are rejected. 180 is no limit.",
        callback=check_tilt,
        show_default=f"{DEFAULT_MAX_TILT:g}",
    ),
]


@dataclass(frozen=True, slots=True)
class MethodOptions:
    """Options of the registration method."""

    method: str = REGISTRATION.option(
        "NAME",
        f"How to register. Methods: {', '.join(METHODS)}.",
        DEFAULT_METHOD,
        callback=refused_by(find_method),
    )
    grid: GridOption = None
    voxel: VoxelOption = None
    max_tilt: TiltOption = None
    seed: int | None = REGISTRATION.option(
        "S", "Seed for methods that use random numbers.", rare=True, callback=check_seed, shown="0"
    )
    settings: list[str] = REGISTRATION.option(
        "KEY=VALUE",
        "Set a field of the Python library's configuration, as hypotheses=24 or keys.step=0.5; may be "
        "repeated (docs/mapping.md).",
        [],
        "--set",
        rare=True,
    )
    device: DeviceOption = None

    @property
    def given(self) -> set[str]:
        """Names of the options that were given, except --method."""
        names = {each.name for each in fields(self)} - {"method"}
        return {_NAMES.get(name, name) for name in names if getattr(self, name) not in (None, [])}

    @property
    def uses_priors(self) -> bool:
        """Whether the method uses measured poses."""
        return "priors" in find_method(self.method).options


_NAMES = {"settings": "set"}  # options whose names differ from the fields'


@dataclass(frozen=True, slots=True)
class ViewOptions:
    """Options for registering scans to views of a finished map by the default method."""

    grid: GridOption = None
    voxel: VoxelOption = None
    max_tilt: TiltOption = None
    device: DeviceOption = None

    @property
    def method(self) -> MethodOptions:
        """These options as those of the default method."""
        return MethodOptions(grid=self.grid, voxel=self.voxel, max_tilt=self.max_tilt, device=self.device)


def changed(config: Any, assignments: Iterable[str]) -> Any:
    """The configuration with the values that --set assigns, as in "hypotheses=24" or "limits.step=2"."""
    for text in assignments:
        path, _, value = text.partition("=")
        config = _changed(config, path.strip().split("."), value, text)
    return config


def _changed(config: Any, path: Sequence[str], value: str, text: str) -> Any:
    names = [each.name for each in fields(config)]
    if path[0] not in names:
        raise InputError(f"--set {text}: there is no {path[0]!r}; choose from {', '.join(names)}")
    before = getattr(config, path[0])
    if is_dataclass(before):
        return replace(config, **{path[0]: _changed(before, path[1:] or [""], value, text)})
    try:
        after = json.loads(value)
    except ValueError:
        after = value
    kind = bool if isinstance(before, bool) else int if isinstance(before, int) else int | float
    if len(path) > 1 or not isinstance(after, kind) or (isinstance(after, bool) != (kind is bool)):
        wanted = "true or false" if kind is bool else "a whole number" if kind is int else "a number"
        raise InputError(f"--set {text}: wanted {wanted}, as in --set {path[0]}={json.dumps(before or 2)}")
    return replace(config, **{path[0]: float(after) if isinstance(before, float) else after})


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
        """The method's entries in summary.json."""
        seed = {} if self.seed is None else {"seed": self.seed}
        grid = {"edge": self.edge, "voxel": self.grid.voxel}
        return {"method": self.name, "grid": grid, "spectral": self.config, **seed}


def require_effect(options: MethodOptions, priors: bool) -> None:
    """Refuse options that the method does not use, and name the methods that do; `priors`: whether a file of priors
    is given."""
    given = options.given | ({"priors"} if priors else set())
    always = {"voxel"} if "voxel" in given else {"voxel", "grid"}  # without a voxel the grid determines its size
    if idle := sorted(given - find_method(options.method).options - always):
        flags = " and ".join(f"--{name.replace('_', '-')}" for name in idle)
        users = " or ".join(name for name, entry in METHODS.items() if set(idle) <= entry.options | always)
        instead = f", or use --method {users}" if users else ""
        raise InputError(f"no effect with --method {options.method}: {flags}; leave out{instead}")


def require_method(options: MethodOptions) -> None:
    """Check the method, the grid and the device before scans are read or received."""
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
    """The method on the grid of the options, or else on one that suits the scans; if more scans may be added later, use
    `survey`, which rounds the voxel."""
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
    """Refuse a grid whose pairs exceed the available memory, if the device uses the machine's memory."""
    if not device.is_cpu:  # a GPU's own memory was checked before
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

    default = HemisphereConfig() if options.method == "hemisphere" else SpectralConfig()
    config = changed(default, options.settings)
    changes = {name: getattr(config, name) for name in (text.partition("=")[0] for text in options.settings)}
    return changes | ({} if options.max_tilt is None else {"max_tilt": math.radians(options.max_tilt)})


def _require_strength(scans: "Sequence[Scan]") -> None:
    bare = [scan.name for scan in scans if scan.strength is None]
    if len(bare) == len(scans):
        raise InputError("--set use_strength=true: no scan has echo strengths, as in a column intensity; leave it out")
    if bare:
        say(f"{len(bare)} of {len(scans)} scans have no echo strength; only their shape is used: {bare[0]} ...")
