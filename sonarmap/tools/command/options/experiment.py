"""The options of `sonarmap reproduce`."""

import math
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Annotated

import typer

from sonarmap.tools.command.options.option import (
    EXPERIMENT,
    INSTRUMENTS,
    MOST_WORKERS,
    OUTPUT,
    RUNNING,
    checked,
    completes,
    completes_list,
    flag,
    option,
    refused_by,
)
from sonarmap.tools.command.options.registration import VoxelOption, check_seed, check_tilt
from sonarmap.tools.lab.reproduce.experiments import ALL, EXPERIMENTS, PAIR_SETS, PAPER
from sonarmap.tools.lab.simulate.scenes.catalog import SCENE_KINDS
from sonarmap.tools.methods.registry import METHODS, find_method

_NAMES = "; ".join(f"{name} ({entry.shows})" for name, entry in EXPERIMENTS.items())
# Steps and noise of the experiments fit the paper's 256 m and are too large for a small scene.
SCENES = [name for name, kind in SCENE_KINDS.items() if kind.scale == 1.0]
_experiment = partial(option, EXPERIMENT)
_rare = partial(_experiment, rare=True)

NameArgument = Annotated[
    str,
    typer.Argument(
        help=f"An experiment, or '{ALL}' for the paper's. There are {_NAMES}. The paper's are {', '.join(PAPER)}.",
        metavar="NAME",
        autocompletion=completes((*EXPERIMENTS, ALL)),
    ),
]
FolderArgument = Annotated[
    Path | None,
    typer.Argument(
        help="For real: a folder with scans and a gt.log, or a folder of such folders. For decisions: where "
        "registrations are kept.",
        metavar="DIR",
        show_default=False,
    ),
]


@dataclass(frozen=True, slots=True)
class ExperimentOptions:
    """What is asked of the experiments; None leaves it to each. The names are those of `Request`."""

    quick: bool = flag(
        EXPERIMENT,
        "--quick",
        "Take at most a minute for each experiment. There are fewer scenes, seeds, pairs and voxels, unless given.",
    )
    scene: str | None = _rare(
        "SCENE",
        f"The scene: {', '.join(SCENES)}.",
        callback=checked(
            SCENES.__contains__, f"{{}} is not a scene as large as the paper's; choose {', '.join(SCENES)}"
        ),
        autocompletion=completes(SCENES),
    )
    sigma2: list[float] | None = _rare(
        "V",
        "Variance of the range noise at the largest range \\[m^2]; may be repeated.",
        callback=checked(
            lambda values: all(0 <= value < math.inf for value in values), "{} m^2; variances must be 0 or more"
        ),
    )
    seeds: int | None = _rare("N", "Number of seeds.", min=1)
    set: list[str] | None = _rare(
        "NAME",
        "For pairs: overlap (of every overlap), paths (Table 1, extended) or unrelated; may be repeated.",
        callback=checked(lambda names: PAIR_SETS.keys() >= {*names}, f"{{}}; choose from {', '.join(PAIR_SETS)}"),
        autocompletion=completes(PAIR_SETS),
        shown="all",
    )
    pairs: int | None = _rare("N", "Number of pairs.", min=1)
    seed: int | None = _rare(
        "S", "The first seed, or the seed of the pairs; the same seed gives the same results.", callback=check_seed
    )
    method: list[str] | None = _experiment(
        "NAME",
        f"A method to evaluate; may be repeated. Methods: {', '.join(METHODS)}.",
        callback=refused_by(lambda names: [find_method(name) for name in names]),
        autocompletion=completes(METHODS),
    )
    grid: int | None = _experiment(
        "N", "Voxels per edge, 16..512. The number is an even product of 2, 3 and 5.", shown="the experiment's"
    )
    voxel: VoxelOption = None
    max_tilt: float | None = _rare(
        "DEG",
        "For real: largest roll and pitch between two scans \\[deg], up to 180 (no limit).",
        shown="35",
        callback=check_tilt,
    )
    known: str | None = _rare(
        "WHAT",
        "For real: also register every pair with measurements of WHAT, drawn about the truth: "
        "attitude,heading,depth,position, or some of them (to 1.5 deg, 3 deg, 0.15 m, 3 m).",
        autocompletion=completes_list(INSTRUMENTS),
    )
    write: bool = flag(
        EXPERIMENT, "--write", "For confidence: store what was fitted in the package, which uses it from then on."
    )


@dataclass(frozen=True, slots=True)
class ExperimentRun:
    """Where results go, and who makes them."""

    out: Path = option(
        OUTPUT,
        "OUT",
        "Folder for the results. A stopped run continues from what is there.",
        Path("reproduction"),
        "-o",
        "--out",
    )
    fresh: bool = flag(RUNNING, "--fresh", "Run all jobs again, finished ones too.")
    workers: int = option(
        RUNNING, "N", "Processes that share the jobs. The results are the same.", 1, min=1, max=MOST_WORKERS
    )
