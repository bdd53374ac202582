"""The folder of a simulation: scan_000.ply, scan_001.ply, ..., truth.tum and description.json."""

from pathlib import Path

from sonarmap.kernels.errors import InputError
from sonarmap.tools.files.readers.clouds.cloud import columns_of
from sonarmap.tools.files.readers.instruments import PRIORS
from sonarmap.tools.files.user_file import package_versions, read_json
from sonarmap.tools.files.writers.atomic import all_or_none
from sonarmap.tools.files.writers.points import write_ply
from sonarmap.tools.files.writers.poses import write_tum
from sonarmap.tools.files.writers.tables import write_json, write_priors
from sonarmap.tools.lab.simulate.sensing.navigation import Fixes, Instruments, dead_reckoning, measure_poses
from sonarmap.tools.lab.simulate.simulation import Simulation, SimulationSettings, settings_from_json

TRUTH = "truth.tum"
DESCRIPTION = "description.json"
ODOMETRY = "odometry.tum"


def write_simulation(
    simulation: Simulation,
    folder: Path,
    instruments: Instruments | None = None,
    fixes: Fixes | None = None,
    drift: tuple[float, float] | None = None,
) -> list[Path]:
    """Write the scans, the truth and the description, and return their paths.

    The same settings give the same bytes (on another processor the last digits may differ). For each scan the
    description holds "unusable": "empty", "noise", or null for a good one. With `instruments` their measurements are
    written as priors.csv; `fixes` says which scans have a position (None: all, without outliers). With `drift`, a share
    of the distance and a rotation [rad/s], dead reckoning is written as odometry.tum. Raises InputError: the folder
    cannot be written, or holds scans or priors that are not part of this simulation.
    """
    folder = Path(folder)
    paths = [folder / f"scan_{number:03d}.ply" for number in range(len(simulation.scans))]
    foreign = sorted(set(folder.glob("scan_*.ply")) - set(paths))
    if foreign:
        raise InputError(
            f"{folder} already holds {foreign[0].name}, which is not part of this simulation of {len(paths)} scans; "
            "choose another folder or remove it"
        )
    if paths[0].exists() and not (folder / DESCRIPTION).exists():
        raise InputError(f"{folder} holds a {paths[0].name} that no simulation wrote; choose another folder")
    if instruments is None and (folder / PRIORS).exists():
        raise InputError(
            f"{folder} already holds a {PRIORS}, which does not belong to these scans; remove it, simulate priors too "
            "(--priors), or choose another folder"
        )
    settings, written = simulation.settings, [*paths, folder / TRUTH, folder / DESCRIPTION]
    with all_or_none():
        _write_files(simulation, folder, paths)
        if instruments is not None:
            measured = measure_poses(simulation.truth.T_world_sensor, instruments, settings.seed, settings.dive)
            priors = (fixes or Fixes()).of(measured, settings.seed, settings.dive)
            kept = [(path.name, prior) for path, prior in zip(paths, priors, strict=True) if prior is not None]
            written.append(folder / PRIORS)
            write_priors(written[-1], [name for name, _ in kept], [prior for _, prior in kept])
        if drift is not None:
            written.append(folder / ODOMETRY)
            write_tum(written[-1], dead_reckoning(simulation.truth, *drift, settings.seed, settings.dive))
    return written


def _write_files(simulation: Simulation, folder: Path, paths: list[Path]) -> None:
    for path, scan in zip(paths, simulation.scans, strict=True):
        write_ply(path, scan.points, columns_of(scan))
    write_tum(folder / TRUTH, simulation.truth)
    content = {
        "settings": simulation.settings,
        "versions": package_versions(),
        "scans": [
            {
                "file": path.name,
                "stamp": scan.stamp,
                "points": len(scan.points),
                "unusable": simulation.faults.get(number),
            }
            for number, (path, scan) in enumerate(zip(paths, simulation.scans, strict=True))
        ],
    }
    write_json(folder / DESCRIPTION, content)


def read_settings(path: Path) -> SimulationSettings:
    """Read the settings of a description.json, from which `simulate` makes the same scans. Raises InputError: the file
    is missing, is not JSON, or has no valid settings."""
    content = read_json(path, "the description.json of a simulation")
    if not isinstance(content, dict) or "settings" not in content:
        raise InputError(f"{path} holds no settings; expected the description.json of a simulation")
    return settings_from_json(content["settings"])
