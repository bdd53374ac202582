"""What the paper says about the limits of roll, pitch and yaw, next to our results."""

from collections.abc import Callable, Sequence
from functools import partial

import numpy as np

from sonarmap.tools.lab.reproduce.experiment import Row, Section
from sonarmap.tools.lab.reproduce.rows import column, rate, where
from sonarmap.tools.lab.reproduce.structures.limits_figure import DEVIATIONS, PEAKS
from sonarmap.tools.lab.reproduce.structures.settings import LimitsSettings
from sonarmap.tools.lab.reproduce.table import Table, table_of

# "Neglectable" (Sect. 2.7) is taken as up to so much [degrees]
_NEGLIGIBLE = 2.0
_SMALL_TILT = 15.0  # [degrees], below which the paper calls the distortions negligible
_CHAIN_DEG, _CHAIN_VOXELS = 6.0, 3.0  # the whole chain is right within these


def limits_section(rows: Sequence[Row], settings: LimitsSettings) -> Section:
    """What the paper says about the limits, next to our results."""
    return Section(
        title="The limits of the resampling: Figs. 7, 8, 9",
        introduction=_introduction(settings),
        tables=(deviation_table(rows), step_table(rows)),
        pictures={
            PEAKS: "The correlations of both steps as roll and pitch grow, as Figs. 7 and 8. Circles and dotted lines "
            "mark the true values.",
            DEVIATIONS: "Errors of the estimates against the tilt, as Fig. 9. Each dot is one registration.",
        },
    )


def deviation_table(rows: Sequence[Row]) -> Table:
    """The paper's statements, our results, and the verdicts."""
    both = where(rows, tilted="both")
    single = [row for row in rows if row["tilted"] != "both"]
    small = [row for row in rows if float(row["tilt_deg"]) <= _SMALL_TILT]
    farthest = max(float(row["tilt_deg"]) for row in rows)
    end = [row for row in rows if row["tilt_deg"] == farthest]
    right = [row for row in end if chain_right(row)]
    claims = [
        ("yaw, with no more than one of roll and pitch", "exact", single, "yaw"),
        (f"roll, yaw given, up to {_SMALL_TILT:g}° of tilt", "negligible", small, "roll"),
        (f"pitch, yaw given, up to {_SMALL_TILT:g}° of tilt", "negligible", small, "pitch"),
    ]
    lines = [(what, paper, *_ours_and_verdict(some, name)) for what, paper, some, name in claims]
    lines.insert(1, _offset_line(both))
    lines.append(
        (
            f"the whole chain at {farthest:g}° (6 degrees, 3 voxels)",
            "the limit of the approach",
            rate(right, end),
            "reached" if len(right) == len(end) else f"{len(end) - len(right)} of {len(end)} fail",
        )
    )
    return Table("What the paper says, and our results", ("quantity", "paper", "ours", "verdict"), tuple(lines))


def step_table(rows: Sequence[Row]) -> Table:
    """Median and largest errors by tilt, and the chain's success."""
    groups = [
        ((tilted, f"{tilt:g}"), where(rows, tilted=tilted, tilt_deg=tilt))
        for tilted in ("none", "roll", "pitch", "both")
        for tilt in sorted({float(row["tilt_deg"]) for row in where(rows, tilted=tilted)})
    ]
    errors = {"yaw error": "yaw", "roll error": "roll", "pitch error": "pitch", "error of the whole chain": "chain"}
    columns: dict[str, Callable[[Sequence[Row]], str]] = {
        heading: partial(_middle_and_largest, name) for heading, name in errors.items()
    }
    columns["chain right"] = lambda some: rate([row for row in some if chain_right(row)], some)
    return table_of("Errors [degrees], median / largest", ("tilted in", "tilt [°]"), groups, columns)


def _middle_and_largest(name: str, rows: Sequence[Row]) -> str:
    sizes = _sizes(rows, name)
    return f"{np.median(sizes):.1f} / {sizes.max():.1f}"


def chain_right(row: Row) -> bool:
    """Whether the whole chain is within 6 degrees and 3 voxels."""
    return float(row["chain_off_deg"]) <= _CHAIN_DEG and float(row["chain_shift_voxels"]) <= _CHAIN_VOXELS


def _offset_line(both: Sequence[Row]) -> tuple[str, str, str, str]:
    """Under roll and pitch yaw's offset is constant over the yaws, in the paper (Fig. 9b)."""
    tilts = sorted({float(row["tilt_deg"]) for row in both})
    ours, medians = [], []
    for tilt in (tilts[0], tilts[len(tilts) // 2], tilts[-1]):
        off = column(where(both, tilt_deg=tilt), "yaw_off_deg")
        medians.append(abs(float(np.median(off))))
        ours.append(f"{np.median(off):+.1f}° ({off.min():+.1f}..{off.max():+.1f}) at {tilt:g}°")
    grows = "grows" if medians == sorted(medians) and medians[-1] > medians[0] else "does not grow"
    words = "constant over the yaws, growing with the tilt"
    return "yaw's offset under roll and pitch alike, median (range)", words, ", ".join(ours), f"{grows} with the tilt"


def _ours_and_verdict(rows: Sequence[Row], name: str) -> tuple[str, str]:
    """Our median and largest errors, and the verdict."""
    sizes = _sizes(rows, name)
    small = int((sizes <= _NEGLIGIBLE).sum())
    verdict = "confirmed" if small == len(sizes) else f"{small} of {len(sizes)}"
    return f"median {np.median(sizes):.1f}°, largest {sizes.max():.1f}°", f"{verdict} (within {_NEGLIGIBLE:g}°)"


def _sizes(rows: Sequence[Row], name: str) -> np.ndarray:
    return np.abs(column(rows, f"{name}_off_deg"))


def _introduction(settings: LimitsSettings) -> str:
    return (
        "The structures of the rotation experiment, without noise, are turned by roll, by pitch, or by both through "
        f"the same angle, up to {settings.tilts_deg[-1]:g} degrees, and by yaws from {settings.yaws_deg[0]:g} to "
        f"{settings.yaws_deg[-1]:g} degrees. Grid: {settings.edge} voxels of {settings.grid.voxel:g} m. The paper's "
        "steps are tested one at a time: first yaw, from its highest peak; then roll and pitch, with the true yaw "
        "given; then the whole chain. As there is no noise, the errors that remain come from the resampling. Seeds "
        f"per scene: {settings.seeds}, from {settings.first_seed} on."
    )
