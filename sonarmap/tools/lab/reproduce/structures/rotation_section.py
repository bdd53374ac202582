"""Turned structures in words and tables: errors of the angles, next to what the paper's figures show."""

from collections.abc import Sequence
from types import MappingProxyType

from sonarmap.tools.lab.reproduce.experiment import Row, Section
from sonarmap.tools.lab.reproduce.rows import accepted, column, middle, rate, where
from sonarmap.tools.lab.reproduce.structures.settings import RotationSettings
from sonarmap.tools.lab.reproduce.table import Table, table_of

# What the paper's Figs. 16 and 17 show: how far estimated angles lie from the true ones [degrees]
PAPER_DEVIATION: MappingProxyType[str, float] = MappingProxyType({"yaw": 5.0, "roll": 3.0, "pitch": 3.0})
PICTURE = "rotation.png"
_SHIFT_VOXELS = 2.0


def rotation_section(rows: Sequence[Row], settings: RotationSettings) -> Section:
    """The deviations under every noise, next to the paper's."""
    caption = (
        f"The first seed of `{settings.scenes[0]}`, as Figs. 16 and 17. Lines are true values, crosses are estimates; "
        "gray marks wrong registrations."
    )
    return Section(
        title="Rotation under noise of the voxels: Figs. 16, 17",
        introduction=_introduction(settings),
        tables=(_deviation_table(rows, settings),),
        pictures={PICTURE: caption},
        remarks=_remarks(rows),
    )


def deviation(row: Row, name: str) -> float:
    """How far an estimated angle is from the true one [degrees], -180..180."""
    off = float(row[f"found_{name}_deg"]) - float(row[f"true_{name}_deg"])
    return (off + 180) % 360 - 180


def within_limits(row: Row) -> bool:
    """Whether the angles deviate no more than in the paper's figures, and the shift is close to zero."""
    turned = all(abs(deviation(row, name)) <= most for name, most in PAPER_DEVIATION.items())
    return turned and float(row["translation_voxels"]) <= _SHIFT_VOXELS


def _deviation_table(rows: Sequence[Row], settings: RotationSettings) -> Table:
    def beyond(some: Sequence[Row]) -> list[Row]:
        return [row for row in some if not within_limits(row)]

    return table_of(
        "Deviations from the true angles [degrees]",
        ("noise", "paper: yaw / roll / pitch"),
        [
            (
                (f"{noise}: largest deviations [°]", " / ".join(f"{most:g}" for most in PAPER_DEVIATION.values())),
                where(rows, noise=noise),
            )
            for noise in settings.noises
        ],
        {
            "ours, largest: yaw / roll / pitch": lambda some: " / ".join(
                f"{max(abs(deviation(row, name)) for row in some):.1f}" for name in PAPER_DEVIATION
            ),
            "verdict": lambda some: f"{len(beyond(some))} beyond" if beyond(some) else "within",
            "within": lambda some: rate([row for row in some if within_limits(row)], some),
            "median error": lambda some: f"{middle(some, 'rotation_deg'):.2f}°",
            "largest shift [voxels]": lambda some: f"{max(column(some, 'translation_voxels')):.1f}",
            "lowest PSR": lambda some: f"{min(column(some, 'psr')):.0f}",
        },
    )


def _remarks(rows: Sequence[Row]) -> str:
    beyond = [row for row in rows if not within_limits(row)]
    if not beyond:
        return "All registrations are within the limits."
    named = ", ".join(
        f"`{row['scene']}` {row['noise']} seed {row['seed']} at {float(row['true_yaw_deg']):.0f}° of yaw"
        for row in beyond
    )
    return f"Beyond the limits: {named}. {len(accepted(beyond))} of these were accepted."


def _introduction(settings: RotationSettings) -> str:
    yaws, bounds, grid = settings.yaws_deg, PAPER_DEVIATION, settings.grid
    return (
        "The structures of the translation experiment are turned about the middle of the grid by R = Rz(yaw) Ry(pitch) "
        f"Rx(roll), with roll and pitch of {settings.tilt_deg:g} degrees and yaw from {yaws[0]:g} to {yaws[-1]:g} "
        f"degrees, and put into the grid of {grid.edge} voxels of {grid.voxel:g} m again; what leaves the grid is "
        "lost. The noise is that of the translation experiment, independent in both volumes. The method is the "
        "paper's, with one yaw peak.\n\nThe paper gives no numbers. Its figures show deviations of up to about "
        f"{bounds['yaw']:g} degrees in yaw and {bounds['roll']:g} degrees in roll and pitch; these are the limits "
        "here. A registration is within the limits only if its shift, which is zero in truth, is also within "
        f"{_SHIFT_VOXELS:g} voxels. Seeds per scene: {settings.seeds}, from {settings.first_seed} on."
    )
