"""The options of `sonarmap map` beside those that verbs share: scans, loops, motion, files, and who works."""

import math
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from sonarmap.kernels.errors import InputError
from sonarmap.tools.command.options.groups import (
    INPUT,
    LOOPS,
    MOST,
    MOST_WORKERS,
    NAVIGATION,
    OUTPUT,
    RUNNING,
    completes,
)
from sonarmap.tools.command.terminal import say
from sonarmap.tools.files.map_folder.names import EXPORTS

if TYPE_CHECKING:
    from sonarmap.slam.mapper import MapperSettings
    from sonarmap.slam.motion.odometry import Odometry
    from sonarmap.spectral.scan import Scan
    from sonarmap.tools.files.readers.navigation.settings import NavigationSettings

_EXPORTS = " or ".join(f"{file.format('')} ({name})" for name, file in EXPORTS.items())


def _check_limit(limit: float | None) -> float | None:
    if limit is None or (math.isfinite(limit) and limit > 0):
        return limit
    raise typer.BadParameter(f"{limit}; give a number above 0, or leave it out where it is not known")


def _limit(name: str, unit: str, what: str) -> Any:
    """An option for what the vehicle's motion cannot exceed."""
    return typer.Option(
        name,
        metavar=unit,
        callback=_check_limit,
        help=what,
        rich_help_panel=LOOPS,
        hidden=True,
        show_default="learned",
    )


def _check_also(formats: list[str]) -> list[str]:
    unknown = [name for name in formats if name not in EXPORTS]
    if unknown:
        raise typer.BadParameter(f"{unknown[0]!r}; choose one of {', '.join(EXPORTS)}")
    return list(dict.fromkeys(formats))


InputsArgument = Annotated[
    list[str],
    typer.Argument(
        help="Scans: files, folders, patterns, topics of bags. They are taken in natural order, scan2 "
        "before scan10; FILE::TOPIC is a topic of a ROS bag or MCAP file, recording.sonar#3 a scan of several.",
        metavar="INPUT...",
        rich_help_panel=INPUT,
    ),
]
AlsoOption = Annotated[
    list[str],
    typer.Option(
        "--also",
        metavar="FORMAT",
        help=f"Also write {_EXPORTS}; may be repeated.",
        callback=_check_also,
        rich_help_panel=OUTPUT,
        hidden=True,
        autocompletion=completes(EXPORTS),
    ),
]
ReportOption = Annotated[
    bool,
    typer.Option(
        "--report/--no-report",
        help="Write report.html, the page that `sonarmap view OUT` opens.",
        rich_help_panel=OUTPUT,
        hidden=True,
    ),
]
WorkersOption = Annotated[
    int | None,
    typer.Option(
        "--workers",
        metavar="N",
        min=1,
        max=MOST_WORKERS,
        help="Processes that register pairs. Each has its own device context; the results are the same.",
        rich_help_panel=RUNNING,
        show_default="1",
    ),
]
SchedulerOption = Annotated[
    str | None,
    typer.Option(
        "--scheduler",
        metavar="ADDRESS",
        help="Register pairs on a Dask cluster, as tcp://10.0.0.5:8786 or tls://...; needs "
        "pip install 'sonarmap\\[cluster]'.",
        rich_help_panel=RUNNING,
        hidden=True,
    ),
]
FreshOption = Annotated[
    bool,
    typer.Option(
        "--fresh", help="Discard the pairs of earlier runs. They are in OUT/journal.sqlite.", rich_help_panel=RUNNING
    ),
]
LoopsOption = Annotated[
    int | None,
    typer.Option(
        "--loops",
        metavar="N",
        min=0,
        max=MOST,
        help="Loops to try per scan and round. 0 is none. Loops that connect distant parts of the track come "
        "first. There are two rounds, and more as long as they improve the poses.",
        rich_help_panel=LOOPS,
        show_default="2",
    ),
]
MaxSpeedOption = Annotated[
    float | None,
    _limit("--max-speed", "M/S", "How fast the vehicle moves at most \\[m/s]; for scans whose stamps are times."),
]
MaxTurnRateOption = Annotated[
    float | None,
    _limit("--max-turn-rate", "DEG/S", "How fast it turns at most \\[deg/s]; for scans whose stamps are times."),
]
MaxStepOption = Annotated[float | None, _limit("--max-step", "M", "How far apart consecutive scans are at most \\[m].")]
KeyStepOption = Annotated[
    float | None,
    typer.Option(
        "--key-step",
        metavar="M",
        callback=_check_limit,
        help="Distance of key scans \\[m]. Only these are registered, the others are placed between them.",
        show_default="a dense stream: as suits it",
        rich_help_panel=LOOPS,
        hidden=True,
    ),
]
MinSeenOption = Annotated[
    int | None,
    typer.Option(
        "--min-seen",
        metavar="N",
        min=1,
        max=MOST,
        help="Leave out false echoes: points that fewer than N scans saw and other scans contradict. "
        "map_all.ply keeps all points; 1 leaves out none.",
        rich_help_panel=OUTPUT,
        hidden=True,
        show_default="2",
    ),
]
OdometryOption = Annotated[
    Path | None,
    typer.Option(
        "--odometry",
        metavar="FILE",
        help="Dead reckoning: TUM, CSV, ROS bag or MCAP. It has times of its own; CSV has stamp and all columns of "
        "a priors file, and FILE::TOPIC chooses a topic of a bag.",
        rich_help_panel=NAVIGATION,
    ),
]
OdometryDriftOption = Annotated[
    str | None,
    typer.Option(
        "--odometry-drift",
        metavar="P,D",
        help="Its standard deviation: percent of the distance \\[%], degrees per hour \\[deg/h].",
        rich_help_panel=NAVIGATION,
        hidden=True,
        show_default="1,10",
    ),
]
DEFAULT_DRIFT = "1,10"


def survey_settings(
    loops: int | None,
    key_step: float | None,
    max_speed: float | None,
    max_turn_rate: float | None,
    max_step: float | None,
    min_seen: int | None,
) -> "MapperSettings":
    """How the survey is put together, as the options say; None leaves the default."""
    from sonarmap.slam.loops.settings import LoopSettings
    from sonarmap.slam.map.component_maps import MIN_SEEN
    from sonarmap.slam.mapper import MapperSettings
    from sonarmap.slam.motion.limits import MotionLimits
    from sonarmap.slam.stream.keys import KeySettings

    limits = MotionLimits(
        speed=math.inf if max_speed is None else max_speed,
        turn_rate=math.inf if max_turn_rate is None else math.radians(max_turn_rate),
        step=math.inf if max_step is None else max_step,
    )
    return MapperSettings(
        LoopSettings() if loops is None else LoopSettings(per_scan=loops),
        limits,
        KeySettings(key_step),
        min_seen=MIN_SEEN if min_seen is None else min_seen,
    )


def odometry_of(
    scans: "Sequence[Scan]", path: Path | None, drift: str | None, settings: "NavigationSettings"
) -> "Odometry | None":
    """The dead reckoning of --odometry at the scans' times; None without.

    Raises:
        InputError: the file cannot be used, or there is a drift without a file.
    """
    if path is None:
        if drift is not None:
            raise InputError("--odometry-drift has no effect without --odometry; give it too, or leave it out")
        return None
    from sonarmap.tools.files.readers.navigation.odometry import parse_drift, read_odometry

    notes: list[str] = []
    odometry = read_odometry(path, scans, *parse_drift(drift or DEFAULT_DRIFT), notes, settings)
    for note in notes:
        say(note)
    return odometry
