"""`sonarmap map`: scans in, a map out."""

import json
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
from tools.cli.terminal import printable, result_console, say

if TYPE_CHECKING:
    from slam.survey import SurveyResult
    from tools.readers import ReadScans

INCOMPLETE = 3
PEAK_EXPLAINED = "peak: how high the correlation stands above its surroundings, in their standard deviations"


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
    follows is a component of its own, in map_2.ply and trajectory_2.tum and so on, and the exit code is 3,
    as it is where a scan cannot be read, which is told and passed over. An earlier
    run's files in OUT are replaced when all is done, not before.
    """
    from slam.survey import Mapper
    from tools.atomic import require_writable
    from tools.project import require_apart, write_survey

    read = _read(inputs)
    require_apart(out, read.files)
    scans = read.scans
    registrar = build_registrar(scans, grid, voxel, max_tilt, device, yaw_peaks)
    mapper = Mapper(registrar, registrar.grid.voxel)
    require_writable(out)
    with growing_progress("mapping", quiet or as_json) as step:
        step(0, len(scans), "preparing the first scans")
        result = mapper.run(scans, step)
    settings = {
        "inputs": inputs,
        "grid": registrar.grid,
        "spectral": registrar.config,
        "mapper": mapper.settings,
    }
    names = [scan.name for scan in scans]
    summary = write_survey(out, result, names, settings, registrar.device, read.unread)
    if as_json:
        typer.echo(json.dumps(json.loads(summary.read_text(encoding="utf-8"))))
    else:
        _print(result, names, out)
    _warn_of_strays(result)
    if len(result.components) > 1:
        _warn(result, names, out)
    if len(result.components) > 1 or read.unread:
        raise typer.Exit(INCOMPLETE)


def _read(inputs: list[str]) -> "ReadScans":
    """The scans that can be read; what cannot is told, and leaves a gap."""
    from kernels.errors import InputError
    from tools.readers import read_survey

    read = read_survey(inputs)
    for note in read.notes:
        say(note)
    if read.unread and len(read.scans) < 2:
        left = f"{len(read.scans)} of {len(read.scans) + len(read.unread)} scans can be read"
        raise InputError(f"{read.unread[0].reason} ({left}; a map wants at least two)")
    for one in read.unread:
        say(f"passed over, which leaves a gap: {one.reason}", "warning: ", "bold yellow")
    return read


def _warn_of_strays(result: "SurveyResult") -> None:
    strays = sum(point_map.left_out for point_map in result.maps)
    if strays:
        say(
            f"{strays:,} points lie too far from the others for the map's voxels and are left out of it",
            "warning: ",
            "bold yellow",
        )


def _warn(result: "SurveyResult", names: list[str], out: Path) -> None:
    """Tell the gaps that nothing bridges, each with its reason, and what became of the parts."""
    part = {scan: c for c, members in enumerate(result.components) for scan in members}
    for pair in result.pairs:
        if pair.role == "sequential" and part[pair.i] != part[pair.j]:
            say(f"gap between {names[pair.i]} and {names[pair.j]}: {pair.reason}", "warning: ", "bold yellow")
    say(
        f"the scans fall into {len(result.components)} parts that no reliable registration joins; each has its own "
        f"map in {out}, the largest in map.ply",
        "warning: ",
        "bold yellow",
    )


def _print(result: "SurveyResult", names: list[str], out: Path) -> None:
    from rich.table import Table
    from rich.text import Text

    table = Table(box=None, pad_edge=False, collapse_padding=True)
    table.add_column("pair", overflow="fold")
    for name in ("role", ""):
        table.add_column(name, no_wrap=True)
    for name in ("peak", "overlap", "yaw", "distance", "seconds"):
        table.add_column(name, justify="right", no_wrap=True)
    for pair in result.pairs:
        label = Text(printable(f"{names[pair.i]} - {names[pair.j]}").replace("\n", "\\n"))
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
    result_console().print(table)
    typer.echo(PEAK_EXPLAINED)
    counts = sorted((len(point_map.points) for point_map in result.maps), reverse=True)
    maps = f"{len(counts)} maps" if len(counts) > 1 else "a map"
    points = " and ".join(f"{count:,}" for count in counts)
    kept = sum(pair.kept for pair in result.pairs)
    typer.echo(f"{len(names)} scans, {kept} of {len(result.pairs)} pairs kept, {maps} of {points} points")
    typer.echo(f"written to {printable(str(out))}: map.ply, map.png, trajectory.tum, graph.g2o, summary.json")
