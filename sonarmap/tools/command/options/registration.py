"""The options that say how scans are registered, each with its check."""

from dataclasses import dataclass, field
from functools import partial
from typing import Annotated

from sonarmap.kernels.errors import InputError
from sonarmap.tools.command.options.checks import checked, is_positive, refused_by
from sonarmap.tools.command.options.option import REGISTRATION, completes, flag, option, value_option
from sonarmap.tools.command.options.running import DeviceOption
from sonarmap.tools.methods.registry import DEFAULT_METHOD, METHODS, find_method

DEFAULT_EDGE = 128
DEFAULT_HYPOTHESES, MOST_HYPOTHESES = 6, 64
DEFAULT_YAW_PEAKS, MOST_YAW_PEAKS = 1, 32
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
        "Voxels per edge, 16..512. The number is an even product of 2, 3 and 5.",
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
SeedOption = Annotated[
    int,
    value_option(
        REGISTRATION,
        "S",
        "Seed for methods that use random numbers. The same seed gives the same result.",
        rare=True,
        callback=check_seed,
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
    max_tilt: float = _registration(
        "DEG",
        "Largest tilt between scans \\[deg]. It bounds roll and pitch; 180 is no limit. Larger results are rejected. "
        "--method hemisphere searches up to 85.",
        DEFAULT_MAX_TILT,
        callback=check_tilt,
    )
    hypotheses: int = _registration(
        "K",
        f"How many candidate rotations to try of each of three frequency bands, 1..{MOST_HYPOTHESES}; more help where "
        "scans have little in common.",
        DEFAULT_HYPOTHESES,
        rare=True,
        callback=checked(
            lambda count: 1 <= count <= MOST_HYPOTHESES,
            f"{{}} rotations; give 1 to {MOST_HYPOTHESES}. Use --hypotheses {DEFAULT_HYPOTHESES}, or more if the scans "
            "have little in common.",
        ),
    )
    yaw_peaks: int = _registration(
        "K",
        f"For --method hemisphere: how many yaw peaks to try, 1..{MOST_YAW_PEAKS}; the paper tries 1.",
        DEFAULT_YAW_PEAKS,
        rare=True,
        callback=checked(
            lambda count: 1 <= count <= MOST_YAW_PEAKS,
            f"{{}} peaks; give 1 to {MOST_YAW_PEAKS}. Use --yaw-peaks 6, or leave it out for the paper's "
            f"{DEFAULT_YAW_PEAKS}.",
        ),
    )
    strength: bool = flag(
        REGISTRATION,
        "--strength/--no-strength",
        "Weight voxels by their echo strength; otherwise, as in the paper, all count the same.",
        rare=True,
    )
    device: DeviceOption = None
    seed: SeedOption = 0
    given: frozenset[str] = field(default=frozenset())  # those of these, and "priors", that the user gave

    @property
    def uses_priors(self) -> bool:
        """Whether the method uses what instruments measured of the poses."""
        return "priors" in find_method(self.method).options
