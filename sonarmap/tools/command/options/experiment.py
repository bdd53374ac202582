"""The options of `sonarmap reproduce`, each with its check."""

from pathlib import Path
from typing import Annotated

import typer

from sonarmap.kernels.errors import InputError
from sonarmap.tools.command.options.groups import (
    EXPERIMENT,
    INPUT,
    INSTRUMENTS,
    MOST_WORKERS,
    OUTPUT,
    RUNNING,
    completes,
    completes_list,
)
from sonarmap.tools.command.options.registration import check_seed, check_tilt
from sonarmap.tools.lab.reproduce.experiments import EVERY, EXPERIMENTS, groups, members
from sonarmap.tools.lab.simulate.scenes.catalog import SCENE_KINDS
from sonarmap.tools.methods.registry import METHODS, find_method

_NAMES = "; ".join(
    f"'{group}' runs {', '.join(f'{name} ({EXPERIMENTS[name].shows})' for name in members(group))}"
    for group in groups()
    if members(group) != (group,)
)
_ALONE = "; ".join(f"{group} ({EXPERIMENTS[group].shows})" for group in groups() if members(group) == (group,))

NameArgument = Annotated[
    str,
    typer.Argument(
        help=f"An experiment, or a group of them. {_NAMES}; {_ALONE}; '{EVERY}' runs all.",
        metavar="NAME",
        rich_help_panel=INPUT,
        autocompletion=completes((*EXPERIMENTS, *groups(), EVERY)),
    ),
]
SCENES = [name for name, kind in SCENE_KINDS.items() if kind.scale == 1.0]


def _check_scene(scene: str | None) -> str | None:
    """Steps and noise of the experiments fit the paper's 256 m and are too large for a small scene."""
    if scene is None or scene in SCENES:
        return scene
    raise typer.BadParameter(f"{scene} is not a scene as large as the paper's; choose {', '.join(SCENES)}")


SceneOption = Annotated[
    str | None,
    typer.Option(
        help=f"The scene: {', '.join(SCENES)}.",
        metavar="SCENE",
        callback=_check_scene,
        rich_help_panel=EXPERIMENT,
        hidden=True,
        autocompletion=completes(SCENES),
    ),
]
PageOption = Annotated[
    Path | None,
    typer.Option(
        "--page",
        metavar="FILE",
        help="Also write a page, such as docs/reproduction.md, on all experiments of the group with results in OUT. "
        "For 'pages': a folder for all pages.",
        rich_help_panel=OUTPUT,
        hidden=True,
    ),
]
NoisesOption = Annotated[
    list[float] | None,
    typer.Option(
        metavar="V",
        help="Variance of the range noise at the largest range \\[m^2]; may be repeated.",
        rich_help_panel=EXPERIMENT,
        hidden=True,
    ),
]
OwnGridOption = Annotated[
    int | None,
    typer.Option(
        "--grid",
        metavar="N",
        help="Voxels per edge, 16..512. The number is an even product of 2, 3 and 5.",
        show_default="the experiment's",
        rich_help_panel=EXPERIMENT,
    ),
]


def _check_own_tilt(tilt: float | None) -> float | None:
    return None if tilt is None else check_tilt(tilt)


def _check_methods(names: list[str] | None) -> list[str] | None:
    for name in names or ():
        try:
            find_method(name)
        except InputError as error:
            raise typer.BadParameter(str(error)) from error
    return names


MethodsOption = Annotated[
    list[str] | None,
    typer.Option(
        "--method",
        metavar="NAME",
        help=f"A method to evaluate; may be repeated. Methods: {', '.join(METHODS)}.",
        callback=_check_methods,
        rich_help_panel=EXPERIMENT,
        autocompletion=completes(METHODS),
    ),
]
WorkersOption = Annotated[
    int,
    typer.Option(
        "--workers",
        metavar="N",
        min=1,
        max=MOST_WORKERS,
        help="Processes that share the jobs. The results are the same.",
        rich_help_panel=RUNNING,
    ),
]
OutOption = Annotated[
    Path,
    typer.Option(
        "-o",
        "--out",
        help="Folder for the results. A stopped run continues from what is there.",
        metavar="OUT",
        rich_help_panel=OUTPUT,
    ),
]
QuickOption = Annotated[
    bool,
    typer.Option(
        "--quick",
        help="Take at most a minute for each experiment. There are fewer scenes, seeds, pairs and voxels, unless "
        "given.",
        rich_help_panel=EXPERIMENT,
    ),
]
FreshOption = Annotated[
    bool,
    typer.Option("--fresh", help="Run all jobs again, finished ones too.", rich_help_panel=RUNNING),
]
SeedsOption = Annotated[
    int | None, typer.Option(metavar="N", help="Number of seeds.", min=1, rich_help_panel=EXPERIMENT, hidden=True)
]
PairsOption = Annotated[
    int | None, typer.Option(metavar="N", help="Number of pairs.", min=1, rich_help_panel=EXPERIMENT, hidden=True)
]
FirstSeedOption = Annotated[
    int | None,
    typer.Option(
        "--seed",
        metavar="S",
        help="The first seed, or the seed of the pairs; the same seed gives the same results.",
        callback=check_seed,
        rich_help_panel=EXPERIMENT,
        hidden=True,
    ),
]
FolderArgument = Annotated[
    Path | None,
    typer.Argument(
        help="For real: a folder with scans and a gt.log. Or a folder of such folders.",
        metavar="DIR",
        show_default=False,
        rich_help_panel=INPUT,
    ),
]
OwnTiltOption = Annotated[
    float | None,
    typer.Option(
        "--max-tilt",
        metavar="DEG",
        help="For real: largest roll and pitch between two scans \\[deg], up to 180 (no limit).",
        show_default="35",
        callback=_check_own_tilt,
        rich_help_panel=EXPERIMENT,
        hidden=True,
    ),
]
KnownOption = Annotated[
    str | None,
    typer.Option(
        "--known",
        metavar="WHAT",
        help="For real: also register every pair with measurements of WHAT, drawn about the truth: "
        "attitude,heading,depth,position, or some of them.",
        rich_help_panel=EXPERIMENT,
        hidden=True,
        autocompletion=completes_list(INSTRUMENTS),
    ),
]
KnownSigmasOption = Annotated[
    str | None,
    typer.Option(
        "--known-sigmas",
        metavar="A,H,D,P",
        help="Standard deviations for --known: attitude, heading \\[deg], depth, position \\[m].",
        show_default="1.5,3,0.15,3",
        rich_help_panel=EXPERIMENT,
        hidden=True,
    ),
]
