"""The experiment on real scans in words."""

from collections.abc import Sequence

from sonarmap.tools.lab.evaluate.trajectory import RIGHT_DEG, RIGHT_VOXELS
from sonarmap.tools.lab.reproduce.evaluation.methods import OURS
from sonarmap.tools.lab.reproduce.experiment import Row, Section
from sonarmap.tools.lab.reproduce.real.figure import ERRORS, OUTCOMES
from sonarmap.tools.lab.reproduce.real.settings import RealSettings
from sonarmap.tools.lab.reproduce.real.tables import pair_table, result_table, time_table, verdict_table
from sonarmap.tools.lab.simulate.sensing.navigation import KINDS


def real_section(rows: Sequence[Row], seconds: Sequence[Row], settings: RealSettings) -> Section:
    """Words, tables and pictures from all rows."""
    return Section(
        title="Pairs of real scans",
        introduction=_introduction(rows, settings),
        tables=(verdict_table(rows), result_table(rows), pair_table(rows)),
        times=(time_table(seconds),),
        pictures={
            OUTCOMES: "Right and wrong registrations by set, believed (dark) or not (light).",
            ERRORS: f"Errors of all registrations; what lies within the lines is right. `{OURS}` stands out.",
        },
    )


def _introduction(rows: Sequence[Row], settings: RealSettings) -> str:
    counts = {name: len({row["pair"] for row in rows if row["set"] == name}) for name in settings.sets}
    sets = ", ".join(f"`{name}` ({count} {'pair' if count == 1 else 'pairs'})" for name, count in counts.items())
    names = ", ".join(f"`{name}`" for name in settings.left_out)
    left_out = f" Left out, as they have no gt.log: {names}." if names else ""
    size = "their size is chosen from the two scans" if settings.voxel is None else f"each of {settings.voxel:g} m"
    return (
        f"Sets: {sets}.{left_out} The grid has {settings.edge} voxels along each edge; {size}. Methods that bound roll "
        f"and pitch between two scans search up to {settings.max_tilt:g} degrees. A registration is right if it is "
        f"within {RIGHT_DEG:g} degrees and {RIGHT_VOXELS:g} voxels of the truth in gt.log, between the scans' frames. "
        "It is believed if the method itself accepts it. The column *known* says what the method was given besides the "
        f"points.{_known(settings)} Wrong answers have no part in the median errors. {settings.compared.words}"
    )


def _known(settings: RealSettings) -> str:
    if not settings.known:
        return ""
    units = dict(zip(KINDS, ("degrees", "degrees", "m", "m"), strict=True))
    sigmas = dict(zip(KINDS, settings.sigmas, strict=True))
    listed = ", ".join(f"{kind} {sigmas[kind]:g} {units[kind]}" for kind in settings.known)
    return (
        f" Measurements of {' and '.join(settings.known)} are drawn about the truth for both scans, with the standard "
        f"deviations {listed} (seeds {settings.seed} to {settings.seed + settings.seeds - 1}, so "
        f"every pair is registered with {settings.seeds} of them); the world is the target's frame, so its z axis has "
        "to be up."
    )
