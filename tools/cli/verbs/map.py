"""`sonarmap map`: scans in, a map out."""

import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from kernels.errors import InputError
from tools.cli.execution import ExecutionOptions, open_execution
from tools.cli.method import build_registrar, method_of
from tools.cli.options import (
    DEFAULT_HYPOTHESES,
    DEFAULT_MAX_TILT,
    DEFAULT_REFINEMENT,
    DEFAULT_SEED,
    DEFAULT_YAW_PEAKS,
    DeviceOption,
    GridOption,
    HypothesesOption,
    JsonOption,
    MaxTiltOption,
    MethodOption,
    PriorSigmasOption,
    PriorsOption,
    QuietOption,
    RefineOption,
    SeedOption,
    StrengthOption,
    VoxelOption,
    YawPeaksOption,
)
from tools.cli.priors import told_priors
from tools.cli.progress import growing_progress
from tools.cli.survey_text import print_survey, warn, warn_of_faults
from tools.cli.terminal import say
from tools.methods.registry import DEFAULT_METHOD

if TYPE_CHECKING:
    from tools.readers.scans import ReadScans

INCOMPLETE = 3
ALSO = ("pcd", "kitti")


def _check_also(formats: list[str]) -> list[str]:
    strange = [name for name in formats if name not in ALSO]
    if strange:
        raise typer.BadParameter(f"{strange[0]}; wanted one of {', '.join(ALSO)}")
    return list(dict.fromkeys(formats))


def command(
    context: typer.Context,
    inputs: Annotated[
        list[str],
        typer.Argument(help="Scans: files, folders or patterns, in natural order.", metavar="INPUT..."),
    ],
    out: Annotated[Path, typer.Option("-o", "--out", help="Folder for the results.", metavar="OUT")],
    method: MethodOption = DEFAULT_METHOD,
    grid: GridOption = None,
    voxel: VoxelOption = None,
    max_tilt: MaxTiltOption = DEFAULT_MAX_TILT,
    hypotheses: HypothesesOption = DEFAULT_HYPOTHESES,
    refine: RefineOption = DEFAULT_REFINEMENT,
    yaw_peaks: YawPeaksOption = DEFAULT_YAW_PEAKS,
    strength: StrengthOption = False,
    priors: PriorsOption = None,
    prior_sigmas: PriorSigmasOption = None,
    also: Annotated[
        list[str],
        typer.Option(
            "--also", metavar="FORMAT", help="Write map.pcd (pcd), trajectory.kitti (kitti) too.", callback=_check_also
        ),
    ] = [],  # noqa: B006 - typer's way to say none
    device: DeviceOption = None,
    workers: Annotated[
        int | None,
        typer.Option(
            "--workers",
            metavar="N",
            min=1,
            help="Register pairs in N processes, each with a device context of its own; 1 if left out, which is this "
            "process. The results are the same.",
        ),
    ] = None,
    scheduler: Annotated[
        str | None,
        typer.Option(
            "--scheduler",
            metavar="ADDRESS",
            help="Register pairs on a Dask cluster, as tcp://10.0.0.5:8786; wants pip install 'sonarmap\\[cluster]'.",
        ),
    ] = None,
    fresh: Annotated[
        bool, typer.Option("--fresh", help="Forget the pairs that an earlier run left in OUT/journal.sqlite.")
    ] = False,
    seed: SeedOption = DEFAULT_SEED,
    as_json: JsonOption = False,
    quiet: QuietOption = False,
) -> None:
    """Register consecutive scans, close loops, optimize, and fuse one map.

    OUT gets map.ply, map.png, loops.png, trajectory.tum, graph.g2o and summary.json. The scans of each folder are a
    survey; several of one place are joined where their scans look alike, and have map_survey_0.ply and so on too. Where
    a pair fails the chain goes on: what nothing joins to the rest is a component of its own, in map_2.ply and
    trajectory_2.tum and so on, and the exit code is 3, as it is where a scan cannot be read, which is told and passed
    over. An earlier run's files in OUT are replaced when all is done, not before.

    Every pair that is done is kept in OUT/journal.sqlite: the same command goes on where a run was stopped, and with
    more scans only their pairs are registered. times.json tells what the run took.
    """
    from slam.mapper import Mapper, MapperSettings
    from tools.prepared import prepared_scans
    from tools.project.folder import JOURNAL, require_apart, write_survey
    from tools.project.times import survey_times
    from tools.writers.atomic import clear_leftovers, require_writable

    wanted, options = method_of(context), _execution_options(workers, scheduler, fresh)
    read = _read(inputs, [priors] if priors else [])
    require_apart(out, read.files)
    scans = told_priors(read.scans, priors, prior_sigmas, strangers=bool(read.unread))
    chosen = build_registrar(scans, wanted)
    mapping = MapperSettings(prepared=prepared_scans(chosen.device, chosen.grid.edge))
    told = {"priors": str(priors), "prior_sigmas": prior_sigmas} if priors else {}
    settings = {"inputs": inputs, **told, **chosen.settings, "mapper": mapping}
    names = [scan.name for scan in scans]
    require_writable(out)
    with open_execution(chosen, mapping.prepared, options, out / JOURNAL, quiet or as_json) as execution:
        clear_leftovers(out)  # the journal's lock says that no other run writes there
        mapper = Mapper(chosen.registrar, chosen.grid.voxel, mapping, execution)
        with growing_progress("mapping", quiet or as_json) as step:
            step(0, len(scans), "preparing the first scans")
            result = mapper.run(scans, step, read.surveys)
        times = survey_times(execution.timings, options.place)
        summary = write_survey(out, result, names, settings, chosen.device, read.unread, also, times)
    if as_json:
        typer.echo(json.dumps(json.loads(summary.read_text(encoding="utf-8"))))
    else:
        print_survey(result, names, out, also)
    warn_of_faults(result, names, out)
    if len(result.components) > 1 or read.unread:
        raise typer.Exit(INCOMPLETE)


def _execution_options(workers: int | None, scheduler: str | None, fresh: bool) -> ExecutionOptions:
    if workers is not None and scheduler is not None:
        raise InputError(
            "--workers are processes of this machine, --scheduler has workers of its own; drop one of the two"
        )
    return ExecutionOptions(workers or 1, scheduler, fresh)


def _read(inputs: list[str], beside: list[Path]) -> "ReadScans":
    """The scans that can be read; what cannot is told, and leaves a gap."""
    from tools.readers.scans import read_survey

    read = read_survey(inputs, beside)
    for note in read.notes:
        say(note)
    if read.unread and len(read.scans) < 2:
        left = f"{len(read.scans)} of {len(read.scans) + len(read.unread)} scans can be read"
        raise InputError(f"{read.unread[0].reason} ({left}; a map wants at least two)")
    for one in read.unread:
        warn(f"passed over, which leaves a gap: {one.reason}")
    return read
