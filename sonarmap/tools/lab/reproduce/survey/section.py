"""Mapped surveys, in words and tables."""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from sonarmap.tools.lab.evaluate.place_recall import AMONG, GAP, OVERLAP
from sonarmap.tools.lab.reproduce.beside import HEADINGS
from sonarmap.tools.lab.reproduce.experiment import Row, Section
from sonarmap.tools.lab.reproduce.figure import legend_below, new_figure
from sonarmap.tools.lab.reproduce.plan import draw_plan, plan
from sonarmap.tools.lab.reproduce.rows import DASH, by_method, column, distinct, middle, number, where
from sonarmap.tools.lab.reproduce.survey.mapped import OURS
from sonarmap.tools.lab.reproduce.survey.row import BETWEEN, FATES, MAP, POSE, ROLES
from sonarmap.tools.lab.reproduce.survey.simulated import DIVES, SurveySettings
from sonarmap.tools.lab.reproduce.table import Table, table_of
from sonarmap.tools.lab.simulate.scenes.scene import build_scene
from sonarmap.tools.products.report.small_png import save_small

PICTURE = "survey.png"


def survey_section(rows: Sequence[Row], seconds: Sequence[Row], settings: SurveySettings) -> Section:
    """Tables of times and memory, which may differ between runs, are apart from the others."""
    maps = where(rows, row=MAP)
    ours = where(maps, system=OURS)
    longest = f"{max(settings.counts)}"
    tables = (_beside(maps), _systems(where(maps, survey=longest)), _growth(ours), _pairs(maps), _places(ours))
    whole = {"total [s]": ("total_s", 1), "per scan [s]": ("per_scan_s", 1)}
    parts = {"registering [s]": ("registering_s", 1), "signatures [s]": ("signing_s", 1)}
    parts |= {"optimizing, choosing loops [s]": ("optimizing_s", 1), "fusing [s]": ("fusing_s", 1)}
    memory = {"peak memory [MiB]": ("peak_memory_mib", 1)}
    title = "The longest survey, by every system; the times of `sonarmap` include the map"
    by_system = [((str(row["system"]),), row) for row in where(seconds, survey=longest)]
    return Section(
        title="Maps of whole surveys",
        tables=tables,
        times=(
            _survey_by_survey(where(seconds, system=OURS), whole | parts | memory),
            table_of(title, ("system",), by_system, _numbers(whole | memory)),
        ),
        pictures={PICTURE: f"Estimated paths on the survey of {longest} scans, over the true plan"},
    )


def _beside(maps: Sequence[Row]) -> Table:
    lines = [line for row in where(maps, system=OURS) for line in _measured(row, maps)]
    return Table("`sonarmap` beside the other systems", ("survey", *HEADINGS), tuple(lines))


def _measured(ours: Row, maps: Sequence[Row]) -> list[tuple[str, ...]]:
    """What was measured of one survey, beside the others that mapped it."""
    others = [row for row in where(maps, survey=ours["survey"], seed=ours["seed"]) if row["system"] != OURS]
    usable = int(ours["scans"]) - int(ours["unusable"])
    missing, wrong = usable - int(ours["placed"]), _wrong(ours)
    measures: list[tuple[str, Callable[[Row], str], str]] = [
        ("usable scans in one map", lambda row: f"{row['placed']} of {usable}", f"{missing} scans are missing in it"),
        (
            "unusable scans in it",
            lambda row: f"{row['placed_unusable']} of {row['unusable']}",
            f"{ours['placed_unusable']} scans in it show nothing of the scene",
        ),
        ("wrong pairs kept", lambda row: f"{_wrong(row)}", "wrong pairs bend the map" if wrong else "none bends it"),
        (
            "error of the poses (ATE) [voxels]",
            lambda row: number(float(row["ate_after_voxels"]), 2),
            f"poses are {float(ours['ate_after_m']):.2f} m off",
        ),
        (
            "poses within their 95 % ellipsoids",
            lambda row: number(float(row["within_95"]), 2),
            f"expect {100 * float(ours['within_95']):.0f} of 100 poses in them",
        ),
    ]
    if ours["survey"] == DIVES:
        apart = "the dives are joined" if ours["components"] == 1 else "the dives are not joined"
        measures.append(("maps, of two scans or more", lambda row: f"{row['components']}", apart))
    return [
        (
            _called(ours),
            what,
            shown(ours),
            "; ".join(f"{row['system']}: {shown(row)}" for row in others) or DASH,
            follows,
        )
        for what, shown, follows in measures
    ]


def _systems(maps: Sequence[Row]) -> Table:
    """The longest survey by every system: medians over the seeds."""
    keys = {
        "ATE [m]": "ate_after_m",
        "ATE [voxels]": "ate_after_voxels",
        "map error, median [m]": "map_median_m",
        "within a voxel": "map_within_voxel",
        "of points seen twice: median [m]": "map_twice_median_m",
        "90 % [m]": "map_twice_p90_m",
        "of these within a voxel": "map_twice_within_voxel",
    }

    def placed(some: Sequence[Row]) -> str:
        scans, unusable, placed = (int(column(some, key).sum()) for key in ("scans", "unusable", "placed"))
        return f"{placed} of {scans - unusable}"

    columns: dict[str, Callable[[Sequence[Row]], str]] = {"placed": placed}
    columns |= {name: lambda some, key=key: number(middle(some, key), 2) for name, key in keys.items()}
    columns["wrong pairs kept"] = lambda some: f"{sum(map(_wrong, some))}" if any(column(some, "pairs")) else DASH
    by_system = by_method(maps, distinct(maps, "system"), "system")
    return table_of("The longest survey, by every system", ("system",), by_system, columns)


def _growth(ours: Sequence[Row]) -> Table:
    """The poses and the map before and after the loops, survey by survey."""
    columns = {
        "placed": ("placed", 0),
        "maps": ("components", 0),
        "ATE before [voxels]": ("ate_before_voxels", 2),
        "after": ("ate_after_voxels", 2),
        "after [°]": ("ate_after_deg", 2),
        "crossings before [m]": ("crossing_before_m", 2),
        "after [m]": ("crossing_after_m", 2),
        "map error, median [m]": ("map_median_m", 2),
        "of points seen twice, 90 % [m]": ("map_twice_p90_m", 2),
        "within 95 %": ("within_95", 2),
        "of positions": ("position_within_95", 2),
        "mean NEES (6)": ("nees_mean", 1),
        "of positions (3)": ("position_nees_mean", 1),
    }
    return _survey_by_survey(ours, columns)


def _survey_by_survey(ours: Sequence[Row], columns: Mapping[str, tuple[str, int]]) -> Table:
    groups = [((_called(row),), row) for row in ours]
    return table_of("`sonarmap`, survey by survey", ("survey",), groups, _numbers(columns))


def _numbers(columns: Mapping[str, tuple[str, int]]) -> dict[str, Callable[[Row], str]]:
    """Heading -> the cell of a row, from the row's key and a number of decimals."""
    return {name: lambda row, key=key, n=n: number(float(row[key]), n) for name, (key, n) in columns.items()}


def _pairs(maps: Sequence[Row]) -> Table:
    """What became of pairs of each kind."""
    groups = []
    for row in maps:
        kinds = {kind: kind for kind in ROLES} | ({BETWEEN: "between the dives"} if row["survey"] == DIVES else {})
        for kind, shown in kinds.items():
            if sum(counts := [int(row[f"{kind}_{fate}"]) for fate in FATES]):
                groups.append(((_called(row), str(row["system"]), shown), dict(zip(FATES, counts, strict=True))))
    columns = {fate.replace("_", " "): lambda counts, fate=fate: str(counts[fate]) for fate in FATES}
    return table_of("Registered pairs, by kind and outcome", ("survey", "system", "pairs"), groups, columns)


def _places(ours: Sequence[Row]) -> Table:
    title = f"Recall of revisits by signatures alone (overlap {OVERLAP:g} or more, over {GAP} scans apart)"
    columns = _numbers({"scans with a revisit": ("revisited", 0)} | {f"among {k}": (f"recall_{k}", 2) for k in AMONG})
    return table_of(title, ("survey",), [((_called(row),), row) for row in ours], columns)


def _called(row: Row) -> str:
    """As in "floodgate 5, 200 scans" or "floodgate 5, 2 dives of 60"."""
    place = f"{row['scene']} {row['seed']}"
    scans = int(row["scans"])
    return f"{place}, 2 dives of {scans // 2}" if row["survey"] == DIVES else f"{place}, {scans} scans"


def _wrong(row: Row) -> int:
    """Pairs that were kept though wrong, those with unusable scans among them."""
    return sum(int(row[f"{role}_kept_wrong"]) for role in ROLES) + int(row["unusable_kept"])


PLAN_HEIGHT = -4.0  # of the section through the scene: the water's surface is at 0 [m]
_PATHS: dict[str, dict[str, Any]] = {
    "true": {"color": "black", "linewidth": 2.4, "label": "true"},
    "before": {"color": "tab:orange", "linewidth": 1.0, "label": "before loops"},
    "after": {"color": "magenta", "linewidth": 1.2, "marker": "o", "markersize": 2.0, "label": "estimated"},
}


def draw_paths(folder: Path, rows: Sequence[Row], settings: SurveySettings) -> None:
    """Write a PNG of the longest survey of the first seed, each path over the true one."""
    chosen = where(rows, seed=settings.first_seed, survey=f"{max(settings.counts)}")
    maps = where(chosen, row=MAP)
    section = plan(build_scene(settings.scene, settings.first_seed).mesh, PLAN_HEIGHT)
    figure = new_figure(5.2 * len(maps) + 0.4, 5.8, dpi=110)
    panels = figure.subplots(1, len(maps), squeeze=False)[0]
    for axes, mapped in zip(panels, maps, strict=True):
        draw_plan(axes, section)
        poses = where(chosen, row=POSE, system=mapped["system"])
        for name, style in _PATHS.items():
            if poses and f"x_{name}_m" in poses[0]:
                axes.plot(column(poses, f"x_{name}_m"), column(poses, f"y_{name}_m"), **style)
        half = section.edge / 2
        axes.set(xlim=(-half, half), ylim=(-half, half), aspect="equal", xlabel="x [m]")
        axes.set_title(f"{mapped['system']}: {float(mapped['ate_after_voxels']):.2f} voxels off", fontsize=11)
    panels[0].set_ylabel("y [m]")
    legend_below(figure, panels[0])
    save_small(figure, folder / PICTURE)
