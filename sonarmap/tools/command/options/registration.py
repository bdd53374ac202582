"""The options that say how scans are registered, each with its check."""

import json
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, fields, is_dataclass, replace
from functools import partial
from typing import Annotated, Any

from sonarmap.kernels.errors import InputError
from sonarmap.tools.command.options.option import (
    REGISTRATION,
    DeviceOption,
    checked,
    completes,
    is_positive,
    option,
    refused_by,
    value_option,
)
from sonarmap.tools.methods.registry import DEFAULT_METHOD, METHODS, find_method

DEFAULT_EDGE = 128
DEFAULT_MAX_TILT = 35.0  # [deg], the paper's range of roll and pitch (Sect. 2.7)

_registration = partial(option, REGISTRATION)


def _require_edge(edge: int) -> None:
    from sonarmap.spectral.grid import Grid  # imports SciPy, which the help can do without

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
)  # that every random generator can use

GridOption = Annotated[
    int | None,
    value_option(
        REGISTRATION,
        "N",
        "Voxels per edge, 16..512: an even product of 2, 3 and 5.",
        callback=refused_by(_require_edge),
        show_default=f"{DEFAULT_EDGE}",
    ),
]
VoxelOption = Annotated[
    float | None,
    value_option(
        REGISTRATION,
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
    value_option(
        REGISTRATION,
        "DEG",
        "Largest roll and pitch between two scans \\[deg]; larger ones are rejected. 180 is no limit.",
        callback=check_tilt,
        show_default=f"{DEFAULT_MAX_TILT:g}",
    ),
]


@dataclass(frozen=True, slots=True)
class MethodOptions:
    """How to register."""

    method: str = _registration(
        "NAME",
        f"How to register. Methods: {', '.join(METHODS)}.",
        DEFAULT_METHOD,
        callback=refused_by(find_method),
        autocompletion=completes(METHODS),
    )
    grid: GridOption = None
    voxel: VoxelOption = None
    max_tilt: TiltOption = None
    seed: int | None = _registration(
        "S", "Seed for methods that use random numbers.", rare=True, callback=check_seed, shown="0"
    )
    settings: list[str] = _registration(
        "KEY=VALUE",
        "Set a field of the configuration that the Python library has, as hypotheses=24 or keys.step=0.5; may be "
        "repeated (docs/mapping.md).",
        [],
        "--set",
        rare=True,
    )
    device: DeviceOption = None

    @property
    def given(self) -> set[str]:
        """Those that the user gave, by the names of their options."""
        names = {each.name for each in fields(self)} - {"method"}
        return {_NAMES.get(name, name) for name in names if getattr(self, name) not in (None, [])}

    @property
    def uses_priors(self) -> bool:
        """Whether the method uses what instruments measured of the poses."""
        return "priors" in find_method(self.method).options


_NAMES = {"settings": "set"}


@dataclass(frozen=True, slots=True)
class ViewOptions:
    """How scans are registered to views of a finished map, by the default method."""

    grid: GridOption = None
    voxel: VoxelOption = None
    max_tilt: TiltOption = None
    device: DeviceOption = None

    @property
    def method(self) -> MethodOptions:
        """The same as options of a method."""
        return MethodOptions(grid=self.grid, voxel=self.voxel, max_tilt=self.max_tilt, device=self.device)


def changed(config: Any, assignments: Iterable[str]) -> Any:
    """A configuration with the fields that --set names, as in "hypotheses=24" or "limits.step=2".

    Raises InputError: there is no such field, or it cannot have this value.
    """
    for text in assignments:
        path, _, value = text.partition("=")
        config = _changed(config, path.strip().split("."), value, text)
    return config


def _changed(config: Any, path: Sequence[str], value: str, text: str) -> Any:
    known = [each.name for each in fields(config)]
    if path[0] not in known:
        raise InputError(f"--set {text}: there is no {path[0]!r}; choose from {', '.join(known)}")
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
