"""`sonarmap simulate`: scans of a scene that is known, with their true poses."""

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from kernels.errors import InputError
from tools.cli.options import QuietOption, check_seed
from tools.cli.progress import growing_progress
from tools.cli.terminal import printable

if TYPE_CHECKING:
    from tools.simulate.simulation import SimulationSettings

DEFAULT_SCENE, DEFAULT_TRAJECTORY, DEFAULT_SENSOR, DEFAULT_SEED = "floodgate", "survey", "eclipse", 1


def command(
    out: Annotated[Path, typer.Option("-o", "--out", help="Folder for the scans.", metavar="DIR")],
    scene: Annotated[
        str | None, typer.Option(help=f"floodgate, harbor or clutter. \\[{DEFAULT_SCENE}]", metavar="NAME")
    ] = None,
    trajectory: Annotated[
        str | None,
        typer.Option(
            help=f"survey, or table1: the paper's reference scan and S0 to S9. \\[{DEFAULT_TRAJECTORY}]", metavar="NAME"
        ),
    ] = None,
    scans: Annotated[int | None, typer.Option(help="How many scans; a survey has 12.", metavar="N", min=1)] = None,
    spacing: Annotated[
        float | None, typer.Option(help="Of a survey's scans along their path \\[m].", metavar="M")
    ] = None,
    sensor: Annotated[
        str | None,
        typer.Option(help=f"Of a survey: eclipse, paper or sonar3d15. \\[{DEFAULT_SENSOR}]", metavar="NAME"),
    ] = None,
    sigma2: Annotated[
        float | None, typer.Option(help="Variance of the range noise at the largest range \\[m^2].", metavar="V")
    ] = None,
    outliers: Annotated[float | None, typer.Option(help="Share of false echoes, 0..1.", metavar="P")] = None,
    dropouts: Annotated[float | None, typer.Option(help="Share of lost echoes, 0..1.", metavar="P")] = None,
    ghosts: Annotated[
        float | None,
        typer.Option(help="Share of beams that tell what they see mirrored in water or wall, 0..1.", metavar="P"),
    ] = None,
    speckle: Annotated[
        float | None, typer.Option(help="Share of the echo strength that fluctuates, 0..1.", metavar="P")
    ] = None,
    threshold: Annotated[
        float | None,
        typer.Option(help="Discard weaker echoes, linear, 0 none. \\[as the sensor; eclipse 0.002]", metavar="V"),
    ] = None,
    like: Annotated[
        Path | None,
        typer.Option(
            help="A description.json: the same scans again, but for noise, threshold and number.", metavar="FILE"
        ),
    ] = None,
    seed: Annotated[
        int | None,
        typer.Option(metavar="S", help=f"Same seed, same result. \\[{DEFAULT_SEED}]", callback=check_seed),
    ] = None,
    quiet: QuietOption = False,
) -> None:
    """Simulate sonar scans of a scene: scan_000.ply and so on, truth.tum and description.json in DIR.

    The same settings give the same files; `--like description.json` takes them all from an earlier run.
    """
    from tools.atomic import require_writable
    from tools.simulate.folder import write_simulation
    from tools.simulate.simulation import simulate

    settings = _settings(like, scene, trajectory, sensor, seed)
    if spacing is not None and settings.trajectory != "survey":
        raise InputError(
            f"--spacing is of a survey's scans, and the trajectory is {settings.trajectory}; drop --spacing"
        )
    noise = {"sigma2": sigma2, "outliers": outliers, "dropouts": dropouts, "ghosts": ghosts, "speckle": speckle}
    settings = replace(settings, noise=replace(settings.noise, **_given(noise)))
    settings = replace(settings, sensor=replace(settings.sensor, **_given({"threshold": threshold})))
    settings = replace(settings, **_given({"count": scans, "spacing": spacing}))
    require_writable(out)
    with growing_progress("simulating", quiet) as step:
        simulation = simulate(settings, progress=lambda done: step(done, settings.count, ""))
    write_simulation(simulation, out)
    typer.echo(f"{len(simulation.scans)} scans of {settings.scene} and their true poses in {printable(str(out))}")


def _settings(
    like: Path | None, scene: str | None, trajectory: str | None, sensor: str | None, seed: int | None
) -> "SimulationSettings":
    """The settings but for noise and number; options that would go unheard are refused."""
    from tools.simulate.folder import read_settings
    from tools.simulate.sensors import SENSORS
    from tools.simulate.series import table1_settings
    from tools.simulate.simulation import SimulationSettings

    if like is not None:
        given = _given({"scene": scene, "trajectory": trajectory, "sensor": sensor, "seed": seed})
        if given:
            dropped = ", ".join(f"--{name}" for name in given)
            raise InputError(f"--like takes the scene, path, sensor and seed from {like}; drop {dropped}, or --like")
        return read_settings(like)
    scene, seed = scene or DEFAULT_SCENE, DEFAULT_SEED if seed is None else seed
    if trajectory == "table1":
        if sensor is not None:
            raise InputError("--trajectory table1 has the paper's sensor, tilted as there; drop --sensor")
        return table1_settings(seed, 1.0, scene)
    sensor = sensor or DEFAULT_SENSOR
    if sensor not in SENSORS:
        raise InputError(f"no sensor is called {sensor!r}; there are {', '.join(SENSORS)}")
    trajectory = trajectory or DEFAULT_TRAJECTORY
    return SimulationSettings(scene=scene, trajectory=trajectory, sensor=SENSORS[sensor], seed=seed)


def _given(options: dict[str, Any]) -> dict[str, Any]:
    return {name: value for name, value in options.items() if value is not None}
