"""What the paper says about the limits of roll, pitch and yaw, next to our results, and figures as its Figs. 7 to 9."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

from sonarmap.tools.lab.reproduce.experiment import Row, Section
from sonarmap.tools.lab.reproduce.figure import new_figure, save_figure
from sonarmap.tools.lab.reproduce.rows import column, rate, where
from sonarmap.tools.lab.reproduce.structures.settings import LimitsSettings
from sonarmap.tools.lab.reproduce.table import Table, table_of

PEAKS, DEVIATIONS = "limits-peaks.png", "limits.png"
_SHOWN_DEG = 45.0  # of the tilt's correlation, either way
_JITTER = 0.6  # [degrees], so that dots of one tilt do not hide each other
# "Neglectable" (Sect. 2.7) is taken as up to so much [degrees]
_NEGLIGIBLE = 2.0
_SMALL_TILT = 15.0  # [degrees], below which the paper calls the distortions negligible
_CHAIN_DEG, _CHAIN_VOXELS = 6.0, 3.0  # the whole chain is right within these


def limits_section(rows: Sequence[Row], _seconds: Sequence[Row], settings: LimitsSettings) -> Section:
    """What the paper says about the limits, next to our results."""
    return Section(
        title="The limits of the resampling: Figs. 7, 8, 9",
        tables=(deviation_table(rows), step_table(rows)),
        pictures={
            PEAKS: "The correlations of both steps as roll and pitch grow, as Figs. 7 and 8. Circles and dotted lines "
            "mark the true values.",
            DEVIATIONS: "Errors of the estimates against the tilt, as Fig. 9. Each dot is one registration.",
        },
    )


def deviation_table(rows: Sequence[Row]) -> Table:
    """The paper's statements, our results, and the verdicts."""
    single = [row for row in rows if row["tilted"] != "both"]
    small = [row for row in rows if float(row["tilt_deg"]) <= _SMALL_TILT]
    farthest = max(column(rows, "tilt_deg"))
    end = where(rows, tilt_deg=farthest)
    right = _chain_right(end)
    near = f"yaw given, up to {_SMALL_TILT:g}° of tilt"
    lines = (
        ("yaw, with no more than one of roll and pitch", "exact", *_ours_and_verdict(single, "yaw")),
        _offset_line(where(rows, tilted="both")),
        (f"roll, {near}", "negligible", *_ours_and_verdict(small, "roll")),
        (f"pitch, {near}", "negligible", *_ours_and_verdict(small, "pitch")),
        (
            f"the whole chain at {farthest:g}° (6 degrees, 3 voxels)",
            "the limit of the approach",
            rate(right, end),
            "reached" if len(right) == len(end) else f"{len(end) - len(right)} of {len(end)} fail",
        ),
    )
    return Table("What the paper says, and our results", ("quantity", "paper", "ours", "verdict"), lines)


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
    columns["chain right"] = lambda some: rate(_chain_right(some), some)
    return table_of("Errors [degrees], median / largest", ("tilted in", "tilt [°]"), groups, columns)


def _middle_and_largest(name: str, rows: Sequence[Row]) -> str:
    sizes = _sizes(rows, name)
    return f"{np.median(sizes):.1f} / {sizes.max():.1f}"


def _chain_right(rows: Sequence[Row]) -> list[Row]:
    """Those whose whole chain is within 6 degrees and 3 voxels."""
    return [
        row
        for row in rows
        if float(row["chain_off_deg"]) <= _CHAIN_DEG and float(row["chain_shift_voxels"]) <= _CHAIN_VOXELS
    ]


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


@dataclass(frozen=True, slots=True)
class Peaks:
    """Both correlations under one tilt."""

    # tilt_deg, yaw_deg: true roll and pitch, true yaw of `row`; `image` is without yaw
    tilt_deg: float
    yaw_deg: float
    image: np.ndarray  # (N, N) correlation over pitch and -roll, zero in the middle
    image_bin_deg: float  # [degrees]
    row: np.ndarray  # (M,) correlation over yaw, from zero on
    row_bin_deg: float  # [degrees]


def draw_peaks(path: Path, peaks: Sequence[Peaks]) -> None:
    """Write a PNG: roll and pitch above (Fig. 7), yaw below (Fig. 8), a column per tilt."""
    figure = new_figure(3.1 * len(peaks), 5.6, dpi=90)
    axes = figure.subplots(2, len(peaks), squeeze=False, sharey="row", height_ratios=(3, 2))
    for k, peak in enumerate(peaks):
        upper, lower = axes[0, k], axes[1, k]
        half = peak.image_bin_deg * len(peak.image) / 2
        # axis 0 is pitch, axis 1 is -roll: shown with roll to the right and pitch upward
        upper.imshow(peak.image[:, ::-1], origin="lower", extent=(-half, half, -half, half), cmap="magma")
        upper.plot(peak.tilt_deg, peak.tilt_deg, "o", markersize=16, markerfacecolor="none", markeredgecolor="cyan")
        upper.set(xlim=(-_SHOWN_DEG, _SHOWN_DEG), ylim=(-_SHOWN_DEG, _SHOWN_DEG), xlabel="roll [degrees]")
        upper.set_title(f"roll = pitch = {peak.tilt_deg:g}°", fontsize=10)
        lower.plot(np.arange(len(peak.row)) * peak.row_bin_deg, peak.row, linewidth=0.8)
        lower.axvline(peak.yaw_deg, color="black", linestyle=":")
        lower.set(xlim=(0, 180), xlabel="yaw [degrees]")
    axes[0, 0].set_ylabel("pitch [degrees]")
    axes[1, 0].set_ylabel("standard deviations")
    save_figure(figure, path)


def draw_deviations(path: Path, rows: Sequence[Row]) -> None:
    """Write a PNG: a column per angle, a dot per registration, its color what was tilted."""
    figure = new_figure(12, 3.6, dpi=90)
    kinds = {"roll": "tab:orange", "pitch": "tab:green", "both": "tab:red", "none": "tab:blue"}
    titles = {"yaw": "yaw, from its highest peak", "roll": "roll, yaw given", "pitch": "pitch, yaw given"}
    for axes, (name, title) in zip(figure.subplots(1, 3), titles.items(), strict=True):
        for number, (kind, color) in enumerate(kinds.items()):
            some = where(rows, tilted=kind)
            tilt = column(some, "tilt_deg") + _JITTER * (number - 1)
            off = column(some, f"{name}_off_deg")
            axes.plot(tilt, off, ".", color=color, markersize=5, label=f"{kind} tilted", alpha=0.7)
        axes.set(title=title, xlabel="tilt [degrees]", ylabel="estimated - true [degrees]")
        axes.grid(alpha=0.3)
    figure.axes[0].legend(fontsize=8, frameon=False)
    save_figure(figure, path)
