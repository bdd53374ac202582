"""`sonarmap map`: scans in, a map out."""

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from tools.cli.method import build_registrar
from tools.cli.options import (
    DeviceOption,
    GridOption,
    JsonOption,
    MaxTiltOption,
    QuietOption,
    VoxelOption,
    YawPeaksOption,
)
from tools.cli.progress import growing_progress
from tools.cli.terminal import say

if TYPE_CHECKING:
    from slam.survey import SurveyResult

INCOMPLETE = 3


def command(
    inputs: Annotated[
        list[str],
        typer.Argument(help="Scans: files, folders or patterns, in natural order.", metavar="INPUT..."),
    ],
    out: Annotated[Path, typer.Option("-o", "--out", help="Folder for the results.", metavar="OUT")],
    grid: GridOption = None,
    voxel: VoxelOption = None,
    max_tilt: MaxTiltOption = 35.0,
    yaw_peaks: YawPeaksOption = 6,
    device: DeviceOption = None,
    as_json: JsonOption = False,
    quiet: QuietOption = False,
) -> None:
    """Register consecutive scans, close loops, optimize, and fuse one map.

    OUT gets map.ply, map.png, trajectory.tum, graph.g2o and summary.json. Where a pair fails the chain goes on: what
    follows is a component of its own, in map_2.ply and trajectory_2.tum and so on, and the exit code is 3.
    """
    from slam.survey import Mapper
    from tools.project import require_writable, write_survey
    from tools.readers import read_scans

    read = read_scans(inputs)
    for note in read.notes:
        say(note)
    scans = read.scans
    registrar = build_registrar(scans, grid, voxel, max_tilt, device, yaw_peaks)
    mapper = Mapper(registrar, registrar.grid.voxel)
    require_writable(out)
    with growing_progress("mapping", quiet or as_json) as step:
        result = mapper.run(scans, step)
    settings = {
        "inputs": inputs,
        "grid": registrar.grid,
        "spectral": registrar.config,
        "mapper": mapper.settings,
    }
    summary = write_survey(out, result, [scan.name for scan in scans], settings, registrar.device)
    if as_json:
        typer.echo(summary.read_text())
    else:
        _print(result, [scan.name for scan in scans], out)
    if len(result.components) > 1:
        say(
            f"the scans fall into {len(result.components)} parts that no reliable registration joins; each has its "
            f"own map in {out}",
            "warning: ",
            "bold yellow",
        )
        raise typer.Exit(INCOMPLETE)


def _print(result: "SurveyResult", names: list[str], out: Path) -> None:
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    from tools.cli.terminal import printable

    table = Table("pair", "role", "", "psr", "overlap", "yaw", "distance", "seconds", box=None)
    for pair in result.pairs:
        label = Text(printable(f"{names[pair.i]} - {names[pair.j]}"))
        verdict = Text("kept", "green") if pair.kept else Text("refused", "red")
        if pair.registration is None:
            table.add_row(label, pair.role, verdict, "", "", "", "", "")
            continue
        registration = pair.registration
        T = registration.T_target_source
        distance = float((T.translation**2).sum() ** 0.5)
        table.add_row(
            label,
            pair.role,
            verdict,
            f"{registration.psr:.0f}",
            f"{registration.overlap:.0%}",
            f"{T.rotation.as_euler('ZYX', degrees=True)[0]:+.1f}°",
            f"{distance:.2f} m",
            f"{registration.seconds:.2f}",
        )
    Console(width=None if sys.stdout.isatty() else 200).print(table)
    points = ", ".join(f"{len(point_map.points):,}" for point_map in result.maps)
    typer.echo(f"{len(names)} scans, {len(result.edges)} edges, a map of {points} points in {printable(str(out))}")
