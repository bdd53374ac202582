"""Settings of experiments: what the command line asks of them, and the values that several of them refuse."""

from collections.abc import Sequence
from dataclasses import fields, replace
from typing import Any, TypeVar

import numpy as np

from sonarmap.kernels.errors import InputError
from sonarmap.spectral.grid import Grid
from sonarmap.tools.lab.reproduce.experiments import Request
from sonarmap.tools.lab.simulate.scenes.catalog import SCENE_KINDS

EXTENT = 256.0  # of the paper's grid [m]
Settings = TypeVar("Settings")
# An option -> the settings that it changes, of those that an experiment has
_OPTIONS = {
    "scene": ("scene", "scenes"),
    "grid": ("edge", "edges"),
    "sigma2": ("sigma2",),
    "seeds": ("seeds",),
    "seed": ("seed", "first_seed"),
    "pairs": ("pairs",),
    "voxel": ("voxel",),
    "max_tilt": ("max_tilt",),
}


def as_asked(usual: Settings, request: Request, **quick: Any) -> Settings:
    """The settings of a dataclass, changed as the options say; of a quick run also as `quick` says where none does.

    Raises:
        InputError: an option's value will not do.
    """
    changes = dict(quick) if request.quick else {}
    names = {field.name for field in fields(usual)}  # pyright: ignore[reportArgumentType]
    for option, settings in _OPTIONS.items():
        value = getattr(request, option)
        for name in names.intersection(settings) if value is not None else ():
            is_list = isinstance(getattr(usual, name), tuple) and not isinstance(value, tuple)
            changes[name] = (value,) if is_list else value
    return replace(usual, **changes)  # pyright: ignore[reportArgumentType]


def paper_grid(edge: int) -> Grid:
    """A grid of `edge` voxels along each edge, as large as the paper's, which has 256 voxels of about 1 m."""
    Grid(edge, 1.0)  # its error names the edge alone
    return Grid(edge, EXTENT / edge)


def check_seeds(seeds: int, first_seed: int) -> None:
    """Refuse less than one seed, and seeds below 0, with an InputError that says what to give."""
    if seeds < 1 or first_seed < 0:
        raise InputError(
            f"{seeds} seeds from {first_seed} on; at least one is needed, and none below 0, as in --seeds 3 --seed 1"
        )


def check_scenes(scenes: Sequence[str]) -> None:
    """Refuse no scene, and unknown ones, with an InputError that says what to give."""
    unknown = [scene for scene in scenes if scene not in SCENE_KINDS]
    if unknown or not scenes:
        raise InputError(f"no scene is called {unknown[0] if unknown else ''!r}; there are {', '.join(SCENE_KINDS)}")


def check_variances(sigma2: Sequence[float]) -> None:
    """Refuse a list of variances [m^2] that is empty, or has one that is negative or not finite."""
    if not sigma2 or not all(np.isfinite(variance) and variance >= 0 for variance in sigma2):
        given = ", ".join(f"{variance:g}" for variance in sigma2) or "no value"
        raise InputError(f"--sigma2: {given}; variances must be 0 m^2 or more, as in --sigma2 1 --sigma2 2")


def check_pairs(pairs: int, seed: int) -> None:
    """Refuse less than one pair, and a seed of the set below 0, with an InputError that says what to give."""
    if pairs < 1 or seed < 0:
        raise InputError(f"{pairs} pairs of the set {seed}; there must be 1 or more, and the seed >= 0")
