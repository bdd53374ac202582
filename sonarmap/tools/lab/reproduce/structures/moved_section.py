"""Moved structures in words, tables and figures: how far shifts reach and how far turns err, next to the paper."""

from collections.abc import Sequence
from pathlib import Path
from types import MappingProxyType

from sonarmap.tools.lab.reproduce.answer import less_turns
from sonarmap.tools.lab.reproduce.experiment import Row, Section
from sonarmap.tools.lab.reproduce.figure import draw_series
from sonarmap.tools.lab.reproduce.rows import accepted, column, middle, number, rate, right, where, wrong
from sonarmap.tools.lab.reproduce.structures.settings import (
    RotationSettings,
    StructureSettings,
    TranslationSettings,
)
from sonarmap.tools.lab.reproduce.table import Table, table_of

# The distance up to which the paper says or shows that registrations succeed [voxels of 1 m] (Figs. 12, 14, 15)
PAPER_REACH = MappingProxyType(
    {"D0": 150.0, "D1": 140.0, "D2": 140.0, "D3": 140.0, "D4": 140.0, "D5": 120.0, "D6": 110.0}
)
_LEGEND = "{}. Lines are true values, crosses are estimates; gray marks wrong registrations."
# File name -> caption, and the noises in it
_SHIFTED = MappingProxyType(
    {
        "translation-D0.png": (_LEGEND.format("Without noise, as Fig. 12"), ("D0",)),
        "translation-100.png": (_LEGEND.format("Swap ratio 1/100, as Fig. 14"), ("D1", "D3", "D5")),
        "translation-25.png": (_LEGEND.format("Swap ratio 1/25, as Fig. 15"), ("D2", "D4", "D6")),
    }
)
_ROUNDING = 0.5  # [m]: 40 steps are 149.7 m and count as the paper's 150
# What the paper's Figs. 16 and 17 show: how far estimated angles lie from the true ones [degrees]
PAPER_DEVIATION = MappingProxyType({"yaw": 5.0, "roll": 3.0, "pitch": 3.0})
_TURNED = "rotation.png"
_SHIFT_VOXELS = 2.0


def translation_section(rows: Sequence[Row], _seconds: Sequence[Row], settings: TranslationSettings) -> Section:
    """The reach under every noise, next to the paper's."""
    return Section(
        title="Translation under noise of the voxels: Figs. 12, 14, 15",
        tables=(_reach_table(rows, settings), _quality_table(rows, settings)),
        pictures={name: caption for name, (caption, noises) in _SHIFTED.items() if set(noises) & set(settings.noises)},
    )


def draw_translation(folder: Path, rows: Sequence[Row], settings: TranslationSettings) -> None:
    """Write the first seed of the first scene, as the paper's figures show it."""
    for name, (_, noises) in _SHIFTED.items():
        if drawn := [noise for noise in noises if noise in settings.noises]:
            draw_series(folder / name, _first(rows, settings), drawn, "distance_m", "true distance [m]")


def rotation_section(rows: Sequence[Row], _seconds: Sequence[Row], settings: RotationSettings) -> Section:
    """The deviations under every noise, next to the paper's."""
    return Section(
        title="Rotation under noise of the voxels: Figs. 16, 17",
        tables=(_deviation_table(rows, settings),),
        pictures={_TURNED: _LEGEND.format(f"The first seed of `{settings.scenes[0]}`, as Figs. 16 and 17")},
    )


def draw_rotation(folder: Path, rows: Sequence[Row], settings: RotationSettings) -> None:
    """Write the first seed of the first scene, as the paper's figures show it."""
    draw_series(folder / _TURNED, _first(rows, settings), settings.noises, "true_yaw_deg", "true yaw [degrees]")


def _first(rows: Sequence[Row], settings: StructureSettings) -> list[Row]:
    return where(rows, scene=settings.scenes[0], seed=settings.first_seed)


def reach(rows: Sequence[Row]) -> float:
    """The farthest shift of one series up to which every one is right [m]; 0 where the first is wrong."""
    far = 0.0
    for row in sorted(rows, key=lambda row: row["distance_m"]):
        if not row["right"]:
            break
        far = float(row["distance_m"])
    return far


def _reach_table(rows: Sequence[Row], settings: TranslationSettings) -> Table:
    farthest = max(column(rows, "distance_m"))
    lines = []
    for noise in settings.noises:
        paper = PAPER_REACH[noise]
        series = [where(rows, scene=scene, noise=noise, seed=seed) for scene, seed in settings.structures]
        worst = min(series, key=reach)
        verdict = "reached" if reach(worst) >= min(paper, farthest) - _ROUNDING else "not reached"
        if verdict == "reached" and farthest < paper - _ROUNDING:
            verdict = f"reached as far as tried ({farthest:.0f} m)"
        within = [row for row in where(rows, noise=noise) if float(row["distance_m"]) <= paper + _ROUNDING]
        shown = (_shown(worst), verdict, " ".join(map(_shown, series)), rate(right(within), within))
        lines.append((f"{noise}: right up to [m]", f"{paper:.0f}", *shown))
    return Table(
        "Largest shift up to which all registrations are right [m]; ≥: right at every shift that was tried",
        ("noise", "paper", "ours, worst series", "verdict", "ours, every series", "right within the paper's range"),
        tuple(lines),
    )


def _shown(series: Sequence[Row]) -> str:
    """How far one series reaches, with a sign where every shift that was tried is right."""
    return f"{'' if wrong(series) else '≥'}{reach(series):.0f}"


def _quality_table(rows: Sequence[Row], settings: TranslationSettings) -> Table:
    def largest(some: Sequence[Row], name: str) -> float:
        return max(column(some, name), default=float("nan"))

    return table_of(
        "Errors, and peak-to-sidelobe ratios (PSR) of right and wrong registrations",
        ("noise",),
        [((noise,), where(rows, noise=noise)) for noise in settings.noises],
        {
            "largest error where right [°, voxels]": lambda some: (
                f"{largest(right(some), 'rotation_deg'):.2f}°, {largest(right(some), 'translation_voxels'):.2f}"
            ),
            "lowest PSR where right": lambda some: f"{min(column(right(some), 'psr'), default=float('nan')):.0f}",
            "highest PSR where wrong": lambda some: (
                number(largest(wrong(some), "psr"), 0) if wrong(some) else "none wrong"
            ),
            "accepted, of the wrong": lambda some: f"{len(accepted(wrong(some)))} of {len(wrong(some))}",
        },
    )


def deviation(row: Row, name: str) -> float:
    """How far an estimated angle is from the true one [degrees], -180..180."""
    return less_turns(float(row[f"found_{name}_deg"]) - float(row[f"true_{name}_deg"]))


def within_limits(row: Row) -> bool:
    """Whether the angles deviate no more than in the paper's figures, and the shift is close to zero."""
    turned = all(abs(deviation(row, name)) <= most for name, most in PAPER_DEVIATION.items())
    return turned and float(row["translation_voxels"]) <= _SHIFT_VOXELS


def _deviation_table(rows: Sequence[Row], settings: RotationSettings) -> Table:
    paper = " / ".join(f"{most:g}" for most in PAPER_DEVIATION.values())

    def within(some: Sequence[Row]) -> list[Row]:
        return [row for row in some if within_limits(row)]

    def verdict(some: Sequence[Row]) -> str:
        beyond = len(some) - len(within(some))
        return f"{beyond} beyond" if beyond else "within"

    return table_of(
        "Deviations from the true angles [degrees]",
        ("noise", "paper: yaw / roll / pitch"),
        [((f"{noise}: largest deviations [°]", paper), where(rows, noise=noise)) for noise in settings.noises],
        {
            "ours, largest: yaw / roll / pitch": lambda some: " / ".join(
                f"{max(abs(deviation(row, name)) for row in some):.1f}" for name in PAPER_DEVIATION
            ),
            "verdict": verdict,
            "within": lambda some: rate(within(some), some),
            "median error": lambda some: f"{middle(some, 'rotation_deg'):.2f}°",
            "largest shift [voxels]": lambda some: f"{max(column(some, 'translation_voxels')):.1f}",
            "lowest PSR": lambda some: f"{min(column(some, 'psr')):.0f}",
        },
    )
