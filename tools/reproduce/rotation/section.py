"""Turned structures for people: how far estimated angles deviate, beside what the paper's figures show."""

from collections.abc import Sequence
from types import MappingProxyType

import numpy as np

from spectral.grid import Grid
from tools.reproduce.experiment import Row, Section
from tools.reproduce.rate import wilson
from tools.reproduce.rotation.settings import RotationSettings
from tools.reproduce.rows import where
from tools.reproduce.structures.voxel_series import ROTATION
from tools.reproduce.table import Table

# What the paper's Figs. 16 and 17 show: how far estimated angles lie from the true ones [degrees]
PAPER_DEVIATION: MappingProxyType[str, float] = MappingProxyType({"yaw": 5.0, "roll": 3.0, "pitch": 3.0})
PICTURE = "rotation.png"
_SHIFT_VOXELS = 2.0


def rotation_section(rows: Sequence[Row], settings: RotationSettings, grid: Grid) -> Section:
    """The deviations of every noise beside the paper's."""
    first = f"The first seed of `{settings.scenes[0]}`, as Figs. 16 and 17: lines true, crosses estimated, gray wrong"
    return Section(
        title="Rotation under noise of the voxels: Figs. 16, 17",
        introduction=_introduction(settings, grid),
        tables=(_deviation_table(rows, settings),),
        times=(),
        pictures={PICTURE: first},
        remarks=_remarks(rows),
    )


def deviation(row: Row, name: str) -> float:
    """How far an estimated angle is from the true one [degrees], -180..180."""
    off = float(row[f"found_{name}_deg"]) - float(row[f"true_{name}_deg"])
    return (off + 180) % 360 - 180


def keeps(row: Row) -> bool:
    """Whether a registration keeps to what the paper's figures show, and does not shift."""
    turned = all(abs(deviation(row, name)) <= most for name, most in PAPER_DEVIATION.items())
    return turned and float(row["translation_voxels"]) <= _SHIFT_VOXELS


def _deviation_table(rows: Sequence[Row], settings: RotationSettings) -> Table:
    lines = []
    for noise in settings.noises:
        some = where(rows, noise=noise)
        kept = wilson(sum(map(keeps, some)), len(some))
        worst = [max((abs(deviation(row, name)) for row in some), default=float("nan")) for name in ROTATION]
        typical = float(np.median([float(row["rotation_deg"]) for row in some]))
        shift = max(float(row["translation_voxels"]) for row in some)
        verdict = "within" if kept.successes == kept.trials else f"{kept.trials - kept.successes} beyond"
        lines.append(
            (
                f"{noise}: largest deviations [°]",
                " / ".join(f"{PAPER_DEVIATION[name]:g}" for name in ROTATION),
                " / ".join(f"{value:.1f}" for value in worst),
                verdict,
                str(kept),
                f"{typical:.2f}°",
                f"{shift:.1f}",
                f"{min(float(row['psr']) for row in some):.0f}",
            )
        )
    headings = (
        *(
            "noise",
            "paper: yaw / roll / pitch",
            "ours, largest: yaw / roll / pitch",
            "verdict",
            "within",
            "median error",
        ),
        *("largest shift [voxels]", "least PSR"),
    )
    return Table("Deviations from the true angles [degrees]", headings, tuple(lines))


def _remarks(rows: Sequence[Row]) -> str:
    beyond = [row for row in rows if not keeps(row)]
    if not beyond:
        return "None of the registrations deviates more."
    named = ", ".join(
        f"`{row['scene']}` {row['noise']} seed {row['seed']} at {float(row['true_yaw_deg']):.0f}° of yaw"
        for row in beyond
    )
    return f"Beyond the bounds: {named}. {sum(bool(row['accepted']) for row in beyond)} of these were accepted."


def _introduction(settings: RotationSettings, grid: Grid) -> str:
    yaws = settings.yaws_deg
    bounds = PAPER_DEVIATION
    return (
        "The structures of the translation experiment, turned about the grid's middle by R = Rz(yaw) Ry(pitch) "
        f"Rx(roll) with roll and pitch of {settings.tilt_deg:g} degrees and yaw from {yaws[0]:g} to {yaws[-1]:g} "
        f"degrees, and put into the {grid.edge} voxels of {grid.voxel:g} m anew; what leaves the frame is lost. "
        "Noise as there, independent in both volumes. The paper's method, one yaw peak.\n\nThe paper tells no "
        f"numbers; what its figures show is taken as up to {bounds['yaw']:g} degrees of deviation in yaw and "
        f"{bounds['roll']:g} in roll and pitch. A registration keeps to it if its shift, zero in truth, is "
        f"within {_SHIFT_VOXELS:g} voxels too. Seeds per scene: {settings.seeds}, from {settings.first_seed} on."
    )
