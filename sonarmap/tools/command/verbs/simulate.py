"""`sonarmap simulate`: scans of a known scene, with their true poses."""

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from sonarmap.kernels.errors import InputError
from sonarmap.tools.command.options.groups import (
    INSTRUMENTS,
    MOST,
    NAVIGATION,
    NOISE,
    OUTPUT,
    SCENE,
    completes,
    completes_list,
)
from sonarmap.tools.command.options.registration import QuietOption, check_seed
from sonarmap.tools.command.progress import growing_progress
from sonarmap.tools.command.terminal import printable
from sonarmap.tools.lab.simulate.scenes.catalog import SCENE_KINDS, SENSOR_NAMES, TRAJECTORY_KINDS

if TYPE_CHECKING:
    from sonarmap.tools.lab.simulate.sensing.navigation import Fixes, Instruments
    from sonarmap.tools.lab.simulate.simulation import SimulationSettings

DEFAULT_SCENE, DEFAULT_TRAJECTORY, DEFAULT_SEED = "floodgate", "survey", 1


def _listed(kinds: dict[str, str]) -> str:
    return f"{', '.join(kinds)}. " + "; ".join(f"{name}: {summary}" for name, summary in kinds.items())


SCENE_HELP = _listed({name: kind.summary for name, kind in SCENE_KINDS.items()})
TRAJECTORY_HELP = _listed(dict(TRAJECTORY_KINDS))
SENSOR_HELP = f"{', '.join(SENSOR_NAMES)}; table1 has its own sensor."


SpacingOption = Annotated[
    float | None,
    typer.Option(
        help="Distance between scans \\[m]. It is for a survey or lawnmower.",
        metavar="M",
        rich_help_panel=SCENE,
        show_default="suits the scene",
    ),
]
GhostsOption = Annotated[
    float | None,
    typer.Option(
        help="Share of beams with a multipath echo, mirrored at the water surface or a wall, 0..1.",
        metavar="P",
        rich_help_panel=NOISE,
        hidden=True,
    ),
]
LobeOption = Annotated[
    float | None,
    typer.Option(
        help="Width of a beam's main lobe, in beams: echoes fade by patches, and neighbors report the strongest.",
        metavar="B",
        rich_help_panel=NOISE,
        hidden=True,
        show_default="0",
    ),
]
ThresholdOption = Annotated[
    float | None,
    typer.Option(
        help="Discard echoes weaker than this, linear; 0 keeps all.",
        metavar="V",
        rich_help_panel=NOISE,
        hidden=True,
        show_default="suits the sensor; eclipse 0.002",
    ),
]
LikeOption = Annotated[
    Path | None,
    typer.Option(
        help="Simulate the scans of a description.json again; noise, threshold, dive and number can be changed.",
        metavar="FILE",
        rich_help_panel=SCENE,
        hidden=True,
    ),
]
PriorsOption = Annotated[
    str | None,
    typer.Option(
        metavar="KINDS",
        help="Also write priors.csv, what instruments would say. KINDS is one or more of "
        "attitude,heading,depth,position.",
        rich_help_panel=NAVIGATION,
        autocompletion=completes_list(INSTRUMENTS),
    ),
]
DiveOption = Annotated[
    int | None,
    typer.Option(
        help="Another pass over the same scene, from another start, with other waves and noise: 2, 3, ...",
        metavar="N",
        rich_help_panel=SCENE,
        hidden=True,
        show_default="1",
    ),
]
UnusableOption = Annotated[
    float | None,
    typer.Option(
        help="Share of scans that are nearly empty or pure noise, 0..1.",
        metavar="P",
        rich_help_panel=NOISE,
        hidden=True,
    ),
]
FixEveryOption = Annotated[
    int | None,
    typer.Option(
        min=1,
        max=MOST,
        metavar="N",
        help="With --priors position: only every N-th scan has a position.",
        rich_help_panel=NAVIGATION,
        hidden=True,
        show_default="1",
    ),
]
FixOutliersOption = Annotated[
    float | None,
    typer.Option(
        min=0,
        max=1,
        metavar="P",
        help="With --priors position: share that is 20 m off, 0..1.",
        rich_help_panel=NAVIGATION,
        hidden=True,
        show_default="0",
    ),
]
FixSigmaOption = Annotated[
    float | None,
    typer.Option(
        metavar="M",
        help="With --priors position: its standard deviation, East and North \\[m].",
        rich_help_panel=NAVIGATION,
        hidden=True,
        show_default="3",
    ),
]
DriftOption = Annotated[
    str | None,
    typer.Option(
        "--odometry",
        metavar="P,D",
        help="Also write odometry.tum, dead reckoning. It drifts by P percent of the way \\[%] and D degrees per hour "
        "\\[deg/h].",
        rich_help_panel=NAVIGATION,
    ),
]
OwnSeedOption = Annotated[
    int | None,
    typer.Option(
        metavar="S",
        help="The same seed gives the same scans.",
        callback=check_seed,
        rich_help_panel=SCENE,
        show_default=f"{DEFAULT_SEED}",
    ),
]


def command(
    out: Annotated[
        Path, typer.Option("-o", "--out", help="Folder for the scans.", metavar="DIR", rich_help_panel=OUTPUT)
    ],
    scene: Annotated[
        str | None,
        typer.Option(
            help=f"{SCENE_HELP}.",
            metavar="NAME",
            rich_help_panel=SCENE,
            show_default=f"{DEFAULT_SCENE}",
            autocompletion=completes(SCENE_KINDS),
        ),
    ] = None,
    trajectory: Annotated[
        str | None,
        typer.Option(
            help=f"{TRAJECTORY_HELP}.",
            metavar="NAME",
            rich_help_panel=SCENE,
            show_default=f"{DEFAULT_TRAJECTORY}",
            autocompletion=completes(TRAJECTORY_KINDS),
        ),
    ] = None,
    scans: Annotated[
        int | None,
        typer.Option(
            help="Number of scans.", metavar="N", min=1, rich_help_panel=SCENE, show_default="survey 12, lawnmower 200"
        ),
    ] = None,
    spacing: SpacingOption = None,
    sensor: Annotated[
        str | None,
        typer.Option(
            help=f"{SENSOR_HELP}",
            metavar="NAME",
            rich_help_panel=SCENE,
            hidden=True,
            show_default="suits the scene",
            autocompletion=completes(SENSOR_NAMES),
        ),
    ] = None,
    sigma2: Annotated[
        float | None,
        typer.Option(
            help="Variance of range noise \\[m^2]. It is that at the largest range.", metavar="V", rich_help_panel=NOISE
        ),
    ] = None,
    outliers: Annotated[
        float | None, typer.Option(help="Share of false echoes, 0..1.", metavar="P", rich_help_panel=NOISE)
    ] = None,
    dropouts: Annotated[
        float | None, typer.Option(help="Share of lost echoes, 0..1.", metavar="P", rich_help_panel=NOISE)
    ] = None,
    ghosts: GhostsOption = None,
    speckle: Annotated[
        float | None,
        typer.Option(
            help="Share of the echo strength that fluctuates as speckle, 0..1.",
            metavar="P",
            rich_help_panel=NOISE,
            hidden=True,
        ),
    ] = None,
    lobe: LobeOption = None,
    threshold: ThresholdOption = None,
    unusable: UnusableOption = None,
    dive: DiveOption = None,
    like: LikeOption = None,
    priors: PriorsOption = None,
    fix_every: FixEveryOption = None,
    fix_outliers: FixOutliersOption = None,
    fix_sigma: FixSigmaOption = None,
    odometry: DriftOption = None,
    seed: OwnSeedOption = None,
    quiet: QuietOption = False,
) -> None:
    """Simulate sonar scans of a scene: DIR gets scan_000.ply and so on, truth.tum and description.json.

    The same settings give the same files; --like description.json takes them from an earlier run.
    """
    from sonarmap.tools.files.writers.atomic import require_writable
    from sonarmap.tools.lab.simulate.folder import write_simulation
    from sonarmap.tools.lab.simulate.simulation import simulate

    settings = _settings(like, scene, trajectory, sensor, seed)
    fixes = _fixes(priors, fix_every, fix_outliers, fix_sigma)
    drift, instruments = _drift(odometry), _instruments(priors, fix_sigma)
    _require_spaced(settings.trajectory, spacing)
    noise = {"sigma2": sigma2, "outliers": outliers, "dropouts": dropouts}
    noise |= {"ghosts": ghosts, "speckle": speckle, "lobe": lobe}
    settings = replace(settings, noise=replace(settings.noise, **_given(noise)))
    settings = replace(settings, sensor=replace(settings.sensor, **_given({"threshold": threshold})))
    settings = replace(settings, **_given({"count": scans, "spacing": spacing, "dive": dive, "unusable": unusable}))
    require_writable(out)
    with growing_progress("simulating", quiet) as step:
        simulation = simulate(settings, progress=lambda done: step(done, settings.count, ""))
    write_simulation(simulation, out, instruments, fixes, drift)
    typer.echo(f"{len(simulation.scans)} scans of {settings.scene} and their true poses in {printable(str(out))}")


def _require_spaced(trajectory: str, spacing: float | None) -> None:
    """Refuse a spacing where the trajectory has none to choose."""
    from sonarmap.tools.lab.simulate.plan import SPACED

    if spacing is not None and trajectory not in SPACED:
        raise InputError(
            f"--spacing has no effect with --trajectory {trajectory}, only with {' or '.join(SPACED)}; leave it out"
        )


def _fixes(priors: str | None, every: int | None, outliers: float | None, sigma: float | None) -> "Fixes":
    """How positions are fixed; what says so is refused where nothing measures them."""
    from sonarmap.tools.lab.simulate.sensing.navigation import Fixes

    if any(value is not None for value in (every, outliers, sigma)) and "position" not in (priors or ""):
        raise InputError(
            "--fix-every, --fix-outliers and --fix-sigma have no effect without --priors position; give it, or leave "
            "them out"
        )
    return Fixes(every or 1, outliers or 0.0)


def _drift(odometry: str | None) -> tuple[float, float] | None:
    from sonarmap.tools.files.readers.navigation.odometry import parse_drift

    return None if odometry is None else parse_drift(odometry, "--odometry")


def _instruments(priors: str | None, sigma: float | None) -> "Instruments | None":
    from sonarmap.tools.lab.simulate.sensing.navigation import instruments_for

    return None if priors is None else instruments_for([kind.strip() for kind in priors.split(",")], sigma)


def _settings(
    like: Path | None, scene: str | None, trajectory: str | None, sensor: str | None, seed: int | None
) -> "SimulationSettings":
    """The settings except noise and number of scans; options without effect are refused."""
    from sonarmap.tools.lab.simulate.folder import read_settings
    from sonarmap.tools.lab.simulate.plan import plan

    if like is not None:
        conflicting = _given({"scene": scene, "trajectory": trajectory, "sensor": sensor, "seed": seed})
        if conflicting:
            flags = ", ".join(f"--{name}" for name in conflicting)
            raise InputError(
                f"--like takes scene, trajectory, sensor and seed from {like}; leave out {flags}, or leave out --like"
            )
        return read_settings(like)
    if trajectory == "table1" and sensor is not None:
        raise InputError("--sensor has no effect with --trajectory table1, which has the paper's sensor; leave it out")
    seed = DEFAULT_SEED if seed is None else seed
    return plan(scene or DEFAULT_SCENE, trajectory or DEFAULT_TRAJECTORY, sensor, seed)


def _given(options: dict[str, Any]) -> dict[str, Any]:
    return {name: value for name, value in options.items() if value is not None}
