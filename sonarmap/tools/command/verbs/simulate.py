"""`sonarmap simulate`: simulated scans of a scene, with their true poses."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from sonarmap.kernels.counted import counted
from sonarmap.kernels.errors import InputError
from sonarmap.tools.command.method import changed, check_seed
from sonarmap.tools.command.option import (
    INSTRUMENTS,
    MOST,
    NAVIGATION,
    NOISE,
    OUTPUT,
    SCENE,
    QuietOption,
    given,
)
from sonarmap.tools.command.terminal import growing_progress, printable
from sonarmap.tools.lab.simulate.scenes.catalog import SCENE_KINDS, SENSOR_NAMES, TRAJECTORY_KINDS

if TYPE_CHECKING:
    from sonarmap.tools.lab.simulate.sensing.navigation import Fixes, Instruments
    from sonarmap.tools.lab.simulate.simulation import SimulationSettings

DEFAULT_SCENE, DEFAULT_TRAJECTORY, DEFAULT_SEED = "floodgate", "survey", 1


def _listed(kinds: dict[str, str]) -> str:
    return f"{', '.join(kinds)}. " + "; ".join(f"{name}: {summary}" for name, summary in kinds.items())


@dataclass(frozen=True, slots=True)
class SimulatedScans:
    """Options of the scene, the trajectory and the sensor; None for the default."""

    scene: str | None = SCENE.option(
        "NAME",
        f"{_listed({name: kind.summary for name, kind in SCENE_KINDS.items()})}.",
        shown=DEFAULT_SCENE,
    )
    trajectory: str | None = SCENE.option(
        "NAME",
        f"{_listed(dict(TRAJECTORY_KINDS))}.",
        shown=DEFAULT_TRAJECTORY,
    )
    scans: int | None = SCENE.option("N", "Number of scans.", shown="survey 12, lawnmower 200", min=1)
    spacing: float | None = SCENE.option(
        "M", "Distance between scans of a survey or lawnmower \\[m].", shown="suits the scene"
    )
    sensor: str | None = SCENE.option(
        "NAME",
        f"{', '.join(SENSOR_NAMES)}; table1 has its own sensor.",
        rare=True,
        shown="suits the scene",
    )
    dive: int | None = SCENE.option(
        "N",
        "Another pass over the same scene, from another start, with other waves and noise: 2, 3, ...",
        rare=True,
        shown="1",
    )
    like: Path | None = SCENE.option(
        "FILE",
        "Simulate the scans of a description.json again; noise, threshold, dive and number can be changed.",
        rare=True,
    )
    seed: int | None = SCENE.option(
        "S", "The same seed gives the same scans.", callback=check_seed, shown=str(DEFAULT_SEED)
    )


@dataclass(frozen=True, slots=True)
class EchoNoise:
    """Options of the noise; None for the sensor's default."""

    sigma2: float | None = NOISE.option("V", "Variance of range noise at the largest range \\[m^2].")
    outliers: float | None = NOISE.option("P", "Share of false echoes, 0..1.")
    dropouts: float | None = NOISE.option("P", "Share of lost echoes, 0..1.")
    settings: list[str] = NOISE.option(
        "KEY=VALUE",
        "Set another field of the settings, as noise.lobe=1 or sweep=0.8; may be repeated (docs/simulation.md).",
        [],
        "--set",
        rare=True,
    )


@dataclass(frozen=True, slots=True)
class SimulatedNavigation:
    """Options of simulated instruments and dead reckoning."""

    priors: str | None = NAVIGATION.option(
        "KINDS",
        "Also write priors.csv with measurements of these instruments: attitude,heading,depth,position, some of them, "
        "or all.",
    )
    fix_every: int | None = NAVIGATION.option(
        "N", "With --priors position: only every N-th scan has a position.", rare=True, shown="1", min=1, max=MOST
    )
    fix_outliers: float | None = NAVIGATION.option(
        "P", "With --priors position: share of positions that are 20 m off, 0..1.", rare=True, shown="0", min=0, max=1
    )
    fix_sigma: float | None = NAVIGATION.option(
        "M", "With --priors position: its standard deviation, East and North \\[m].", rare=True, shown="3"
    )
    odometry_drift: str | None = NAVIGATION.option(
        "P,D",
        "Also write odometry.tum, dead reckoning. It drifts by P percent of the distance \\[%] and D degrees per "
        "hour \\[deg/h].",
    )

    @property
    def kinds(self) -> Sequence[str]:
        """The instruments of --priors; none without it."""
        if self.priors is None:
            return ()
        return INSTRUMENTS if self.priors == "all" else [kind.strip() for kind in self.priors.split(",")]

    def fixes(self) -> "Fixes":
        """How positions are fixed; the options for it are refused without --priors position."""
        from sonarmap.tools.lab.simulate.sensing.navigation import Fixes

        options = (self.fix_every, self.fix_outliers, self.fix_sigma)
        if any(value is not None for value in options) and "position" not in self.kinds:
            raise InputError("--fix-every, --fix-outliers and --fix-sigma have no effect without --priors position")
        return Fixes(self.fix_every or 1, self.fix_outliers or 0.0)

    def drift(self) -> tuple[float, float] | None:
        """Drift of dead reckoning: a share of the distance, and a rotation per second [rad/s]; None without it."""
        from sonarmap.tools.files.readers.navigation.odometry import parse_drift

        return None if self.odometry_drift is None else parse_drift(self.odometry_drift, "--odometry-drift")

    def measured(self) -> "Instruments | None":
        """The instruments with their errors; None without --priors."""
        from sonarmap.tools.lab.simulate.sensing.navigation import instruments_for

        return instruments_for(self.kinds, self.fix_sigma) if self.kinds else None


def command(
    out: Annotated[Path, OUTPUT.value("DIR", "Folder for the scans.", "-o", "--out")],
    scans: SimulatedScans,
    noise: EchoNoise,
    navigation: SimulatedNavigation,
    quiet: QuietOption = False,
) -> None:
    """Simulate sonar scans of a scene: DIR gets scan_000.ply and so on, truth.tum and description.json.

    The same settings give the same files; --like description.json takes them from an earlier run.
    """
    from sonarmap.tools.files.writers.atomic import require_writable
    from sonarmap.tools.lab.simulate.folder import write_simulation
    from sonarmap.tools.lab.simulate.plan import SPACED
    from sonarmap.tools.lab.simulate.simulation import simulate

    settings = _settings(scans)
    fixes, drift, instruments = navigation.fixes(), navigation.drift(), navigation.measured()
    if scans.spacing is not None and settings.trajectory not in SPACED:
        raise InputError(
            f"--spacing has no effect with --trajectory {settings.trajectory}, only with {' or '.join(SPACED)}"
        )
    several = {"count": scans.scans, "spacing": scans.spacing, "dive": scans.dive}
    disturbed = {"sigma2": noise.sigma2, "outliers": noise.outliers, "dropouts": noise.dropouts}
    settings = replace(settings, noise=replace(settings.noise, **given(disturbed)), **given(several))
    settings = changed(settings, noise.settings)
    require_writable(out)
    with growing_progress("simulating", quiet) as step:
        simulation = simulate(settings, progress=lambda done: step(done, settings.count, ""))
    write_simulation(simulation, out, instruments, fixes, drift)
    typer.echo(
        f"{counted(len(simulation.scans), 'scan')} of {settings.scene} and their true poses in {printable(str(out))}"
    )


def _settings(scans: SimulatedScans) -> "SimulationSettings":
    """The settings without the changes by --scans, --spacing, --dive and noise; refuses options without effect."""
    from sonarmap.tools.lab.simulate.folder import read_settings
    from sonarmap.tools.lab.simulate.plan import plan

    if scans.like is not None:
        fixed = {name: getattr(scans, name) for name in ("scene", "trajectory", "sensor", "seed")}
        if conflicting := given(fixed):
            flags = ", ".join(f"--{name}" for name in conflicting)
            raise InputError(f"--like takes them from {scans.like}; leave out {flags}, or leave out --like")
        return read_settings(scans.like)
    if scans.trajectory == "table1" and scans.sensor is not None:
        raise InputError("--sensor has no effect with --trajectory table1, which has the paper's sensor; leave it out")
    seed = DEFAULT_SEED if scans.seed is None else scans.seed
    return plan(scans.scene or DEFAULT_SCENE, scans.trajectory or DEFAULT_TRAJECTORY, scans.sensor, seed)
