"""Moved structures in words, tables and figures: how far shifts reach and how far turns err, next to the paper."""

from collections.abc import Sequence
from pathlib import Path
from types import MappingProxyType

from sonarmap.tools.lab.reproduce.answer import less_turns
from sonarmap.tools.lab.reproduce.experiment import Row, Section
from sonarmap.tools.lab.reproduce.figure import draw_series
from sonarmap.tools.lab.reproduce.rows import accepted, column, grouped, middle, number, rate, right, where, wrong
from sonarmap.tools.lab.reproduce.structures.settings import (
    RIGHT_DEG,
    RIGHT_VOXELS,
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
        introduction=_on_shifts(settings),
        tables=(_reach_table(rows, settings), _quality_table(rows, settings)),
        pictures={name: caption for name, (caption, noises) in _SHIFTED.items() if set(noises) & set(settings.noises)},
        remarks=_what_is_left(rows, settings),
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
        introduction=_on_turns(settings),
        tables=(_deviation_table(rows, settings),),
        pictures={_TURNED: _LEGEND.format(f"The first seed of `{settings.scenes[0]}`, as Figs. 16 and 17")},
        remarks=_beyond(rows),
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


def _what_is_left(rows: Sequence[Row], settings: TranslationSettings) -> str:
    left = {scene: min(column(some, "common")) for (scene,), some in grouped(rows, "scene").items()}
    shares = ", ".join(f"{left[scene]:.0%} of `{scene}`" for scene in settings.scenes)
    turned = sum(column(wrong(rows), "rotation_deg") > RIGHT_DEG)
    why = f" Of the {len(wrong(rows))} wrong registrations, {turned} have a wrong rotation." if wrong(rows) else ""
    return f"At the farthest shift, the share of the structure left in the grid is {shares} (lowest of all seeds).{why}"


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


def _beyond(rows: Sequence[Row]) -> str:
    beyond = [row for row in rows if not within_limits(row)]
    if not beyond:
        return "All registrations are within the limits."
    named = ", ".join(
        f"`{row['scene']}` {row['noise']} seed {row['seed']} at {float(row['true_yaw_deg']):.0f}° of yaw"
        for row in beyond
    )
    return f"Beyond the limits: {named}. {len(accepted(beyond))} of these were accepted."


def _on_shifts(settings: TranslationSettings) -> str:
    scenes = " and of ".join(f"`{scene}`" for scene in settings.scenes)
    grid = settings.grid
    return (
        f"A whole structure (all surfaces of {scenes}, not only what a sensor sees of them) is put into a grid of "
        f"{grid.edge} voxels of {grid.voxel:g} m, with the middle of its height in the middle of the grid. It is then "
        f"shifted by {settings.steps[0]} to {settings.steps[-1]} steps of (1, 2, 3) m, so that more and more of it "
        "leaves the grid. As in Sect. 3 of the paper, a share of the voxels is swapped between occupied and empty, "
        "independently in both volumes: none in D0; 1/100 in D1, D3 and D5; 1/25 in D2, D4 and D6. D1 and D2 swap only "
        "among voxels within 5 voxels of the structure, D3 and D4 within 10 voxels, D5 and D6 among all voxels.\n\n"
        "The paper's method registers the two volumes. It searches all six parameters, starting from one yaw peak. A "
        f"registration is right if it is within {RIGHT_VOXELS:g} voxels and {RIGHT_DEG:g} degrees of the truth. Seeds "
        f"per scene: {settings.seeds}, from {settings.first_seed} on. In a grid of 256 voxels the shifts are whole "
        "voxels, as in the paper; so without noise, the part of the structure that is left in the grid is the same in "
        "both volumes, voxel by voxel."
    )


def _on_turns(settings: RotationSettings) -> str:
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
