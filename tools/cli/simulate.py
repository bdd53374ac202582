"""`sonarmap simulate`: scans of a scene that is known, with their true poses."""

from dataclasses import replace
from pathlib import Path
from typing import Annotated

import typer

from tools.cli.options import QuietOption, SeedOption
from tools.cli.progress import growing_progress
from tools.cli.terminal import printable


def command(
    out: Annotated[Path, typer.Option("-o", "--out", help="Folder for the scans.", metavar="DIR")],
    scene: Annotated[str, typer.Option(help="floodgate, harbor or clutter.", metavar="NAME")] = "floodgate",
    trajectory: Annotated[
        str, typer.Option(help="survey, or table1: the paper's reference scan and S0 to S9.", metavar="NAME")
    ] = "survey",
    scans: Annotated[int | None, typer.Option(help="How many scans; a survey has 12.", metavar="N", min=1)] = None,
    spacing: Annotated[
        float | None, typer.Option(help="Of a survey's scans along their path \\[m].", metavar="M")
    ] = None,
    sensor: Annotated[str, typer.Option(help="eclipse, paper or sonar3d15.", metavar="NAME")] = "eclipse",
    sigma2: Annotated[
        float | None, typer.Option(help="Variance of the range noise at the largest range \\[m^2].", metavar="V")
    ] = None,
    outliers: Annotated[float | None, typer.Option(help="Share of false echoes, 0..1.", metavar="P")] = None,
    dropouts: Annotated[float | None, typer.Option(help="Share of lost echoes, 0..1.", metavar="P")] = None,
    like: Annotated[Path | None, typer.Option(help="A description.json: the same scans again.", metavar="FILE")] = None,
    seed: SeedOption = 1,
    quiet: QuietOption = False,
) -> None:
    """Simulate sonar scans of a scene: scan_000.ply and so on, truth.tum and description.json in DIR.

    The same settings give the same files; `--like description.json` takes them all from an earlier run.
    """
    from kernels.errors import InputError
    from tools.atomic import require_writable
    from tools.simulate.folder import read_settings, write_simulation
    from tools.simulate.sensors import SENSORS
    from tools.simulate.series import table1_settings
    from tools.simulate.simulation import SimulationSettings, simulate

    if like is not None:
        settings = read_settings(like)
    elif sensor not in SENSORS:
        raise InputError(f"no sensor is called {sensor!r}; there are {', '.join(SENSORS)}")
    elif trajectory == "table1":
        settings = table1_settings(seed, 1.0 if sigma2 is None else sigma2, scene)
    else:
        settings = SimulationSettings(scene=scene, trajectory=trajectory, sensor=SENSORS[sensor], seed=seed)
    noise = {"sigma2": sigma2, "outliers": outliers, "dropouts": dropouts}
    settings = replace(settings, noise=replace(settings.noise, **{k: v for k, v in noise.items() if v is not None}))
    changes = {"count": scans, "spacing": spacing}
    settings = replace(settings, **{k: v for k, v in changes.items() if v is not None})
    require_writable(out)
    with growing_progress("simulating", quiet) as step:
        simulation = simulate(settings, progress=lambda done: step(done, settings.count, ""))
    write_simulation(simulation, out)
    typer.echo(f"{len(simulation.scans)} scans of {settings.scene} and their true poses in {printable(str(out))}")
