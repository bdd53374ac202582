"""What the paper says of the limits of roll, pitch and yaw, beside what is found."""

from collections.abc import Sequence

import numpy as np

from spectral.grid import Grid
from tools.reproduce.experiment import Row, Section
from tools.reproduce.limits.figure import DEVIATIONS, PEAKS
from tools.reproduce.limits.settings import LimitsSettings
from tools.reproduce.rate import wilson
from tools.reproduce.rows import where
from tools.reproduce.table import Table

# "Neglectable" (Sect. 2.7) is taken as up to so much [degrees]
_NEGLIGIBLE = 2.0
_SMALL_TILT = 15.0  # [degrees], below which the paper calls the distortions negligible
_CHAIN_DEG, _CHAIN_VOXELS = 6.0, 3.0  # the whole chain is right within these


def limits_section(rows: Sequence[Row], settings: LimitsSettings, grid: Grid) -> Section:
    """What the paper says of the limits beside what is found."""
    return Section(
        title="The limits of the resampling: Figs. 7, 8, 9",
        introduction=_introduction(settings, grid),
        tables=(deviation_table(rows), step_table(rows)),
        times=(),
        pictures={
            PEAKS: "The correlations of both steps under ever more roll and pitch, as Figs. 7 and 8; circles and "
            "dotted lines are true",
            DEVIATIONS: "Deviations of the estimates over the tilt, as Fig. 9; each dot is one registration",
        },
    )


def deviation_table(rows: Sequence[Row]) -> Table:
    """The paper's sentences, ours, and the verdict."""
    both = where(rows, tilted="both")
    single = [row for row in rows if row["tilted"] != "both"]
    small = [row for row in rows if float(row["tilt_deg"]) <= _SMALL_TILT]
    farthest = max(float(row["tilt_deg"]) for row in rows)
    end = [row for row in rows if row["tilt_deg"] == farthest]
    right = sum(chain_right(row) for row in end)
    claims = [
        ("yaw, with no more than one of roll and pitch", "exact", single, "yaw"),
        (f"roll, yaw given, up to {_SMALL_TILT:g}° of tilt", "negligible", small, "roll"),
        (f"pitch, yaw given, up to {_SMALL_TILT:g}° of tilt", "negligible", small, "pitch"),
    ]
    lines = [(what, paper, *_ours_and_verdict(some, f"{name}_off_deg")) for what, paper, some, name in claims]
    lines.insert(1, _offset_line(both))
    lines.append(
        (
            f"the whole chain at {farthest:g}° (6 degrees, 3 voxels)",
            "the limit of the approach",
            str(wilson(right, len(end))),
            "reached" if right == len(end) else f"{len(end) - right} of {len(end)} fail",
        )
    )
    return Table("What is told, and what is found", ("what", "paper", "ours", "verdict"), tuple(lines))


def step_table(rows: Sequence[Row]) -> Table:
    """Median and largest deviations by tilt, and the chain's success."""
    lines = []
    for tilted in ("none", "roll", "pitch", "both"):
        for tilt in sorted({float(row["tilt_deg"]) for row in where(rows, tilted=tilted)}):
            some = where(rows, tilted=tilted, tilt_deg=tilt)
            cells = [
                f"{np.median(_sizes(some, name)):.1f} / {_sizes(some, name).max():.1f}"
                for name in ("yaw_off_deg", "roll_off_deg", "pitch_off_deg", "chain_off_deg")
            ]
            lines.append((tilted, f"{tilt:g}", *cells, str(wilson(sum(map(chain_right, some)), len(some)))))
    headings = ("tilted", "by [degrees]", "yaw off", "roll off", "pitch off", "chain off", "chain right")
    return Table("Deviations [degrees], median / largest", headings, tuple(lines))


def chain_right(row: Row) -> bool:
    """Whether the whole chain is within 6 degrees and 3 voxels."""
    return float(row["chain_off_deg"]) <= _CHAIN_DEG and float(row["chain_shift_voxels"]) <= _CHAIN_VOXELS


def _offset_line(both: Sequence[Row]) -> tuple[str, str, str, str]:
    """Under roll and pitch yaw's offset is constant over the yaws, in the paper (Fig. 9b)."""
    tilts = sorted({float(row["tilt_deg"]) for row in both})
    ours, medians = [], []
    for tilt in (tilts[0], tilts[len(tilts) // 2], tilts[-1]):
        off = np.array([float(row["yaw_off_deg"]) for row in where(both, tilt_deg=tilt)])
        medians.append(abs(float(np.median(off))))
        ours.append(f"{np.median(off):+.1f}° ({off.min():+.1f}..{off.max():+.1f}) at {tilt:g}°")
    grows = "grows" if medians == sorted(medians) and medians[-1] > medians[0] else "does not grow"
    words = "constant over the yaws, growing with the tilt"
    return "yaw's offset under roll and pitch alike, median (range)", words, ", ".join(ours), f"{grows} with the tilt"


def _ours_and_verdict(rows: Sequence[Row], name: str) -> tuple[str, str]:
    """Ours, and the verdict."""
    sizes = _sizes(rows, name)
    small = int((sizes <= _NEGLIGIBLE).sum())
    verdict = "confirmed" if small == len(sizes) else f"{small} of {len(sizes)}"
    return f"median {np.median(sizes):.1f}°, largest {sizes.max():.1f}°", f"{verdict} (within {_NEGLIGIBLE:g}°)"


def _sizes(rows: Sequence[Row], name: str) -> np.ndarray:
    return np.abs([float(row[name]) for row in rows])


def _introduction(settings: LimitsSettings, grid: Grid) -> str:
    return (
        "Structures as in the rotation experiment, without noise, turned by roll, by pitch, or by both alike, "
        f"up to {settings.tilts_deg[-1]:g} degrees, under yaws from {settings.yaws_deg[0]:g} to "
        f"{settings.yaws_deg[-1]:g}. Grid: {grid.edge} voxels of {grid.voxel:g} m. Each of the paper's steps is "
        "looked at for itself: yaw as its highest peak says it, roll and pitch with the true yaw given, and the "
        "whole chain. What one step leaves over is what the resampling cannot tell. Seeds per scene: "
        f"{settings.seeds}, from {settings.first_seed} on."
    )
