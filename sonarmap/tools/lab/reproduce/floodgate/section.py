"""The flood gate's maps in words and tables."""

from collections.abc import Sequence
from statistics import median
from typing import Any

from sonarmap.tools.lab.evaluate.trajectory import RIGHT_DEG
from sonarmap.tools.lab.reproduce.experiment import Row, Section
from sonarmap.tools.lab.reproduce.floodgate.chain import (
    COMPARED,
    MAP_90,
    PAIR,
    POSE,
    RIGHT_M,
    TRUTH,
    VOXEL,
    Run,
    by_run,
    label,
)
from sonarmap.tools.lab.reproduce.floodgate.figure import PICTURES
from sonarmap.tools.lab.reproduce.floodgate.tables import (
    AS_GOOD,
    CLEARLY,
    GOOD_M,
    ends,
    map_table,
    pair_table,
    pose_table,
    times_tables,
    verdict_table,
)
from sonarmap.tools.lab.reproduce.rows import accepted, column, distinct, middle, rate, right, wrong
from sonarmap.tools.lab.reproduce.settings import EXTENT


def floodgate_section(rows: Sequence[Row], seconds: Sequence[Row], settings: Any) -> Section:
    """The paper's statements next to our results, errors, and Table 2; `settings` are FloodgateSettings."""
    return Section(
        title="A flood gate, eighteen scans: Sect. 4, Table 2, Figs. 22 to 31",
        introduction=_introduction(settings, distinct(rows, "seed")),
        tables=(verdict_table(rows), map_table(rows), pair_table(rows), pose_table(rows)),
        times=times_tables(seconds),
        pictures=PICTURES,
        remarks=remarks(rows),
    )


def _introduction(settings: Any, seeds: Sequence[str]) -> str:
    grids = " and ".join(f"{edge}³ ({EXTENT / edge:g} m)" for edge in settings.edges)
    listed = "\n".join(f"- **{name}**: {COMPARED[name].title}" for name in COMPARED if name in settings.methods)
    absent = f"\n\nNot installed, so left out: {', '.join(settings.left_out)}." if settings.left_out else ""
    named = ", ".join(seeds)
    return f"""The paper's scans of the Lesumer Sperrwerk are not public. Ours are simulated: a flood gate of the same
kind, seen by a sensor like the Tritech Eclipse on a path in front of the gate. The true pose of every scan and the true
surface are known. Every method registers every scan to the one before it and knows nothing about the motion. A map is
made by chaining these registrations, starting from the true pose of the first scan; every registration is used, whether
its method accepts it or not. There is no loop closure and no SLAM, as in the paper. Surveys: seeds {named}; each has
its own sea bed, waves and noise.

A pair is right if it is within {RIGHT_DEG:g}° and {RIGHT_M:g} m of the truth at the sensor, for every method. A map is
measured by the distances of all its points to the true surface (point to triangle, exact), and compared with the map
made with true poses, whose distances come from noise alone. A map corresponds to the truth if the distance within which
90 % of its points lie is at most {GOOD_M:g} m, the paper's finer voxel, larger than with true poses. A map is at least
as good as another if that distance is at most {AS_GOOD:g} times the other's, and clearly better if it is at most
{CLEARLY:g} times the other's. These thresholds were set before any run. Points that are displaced along the sea bed
still lie on it, so the table also shows how far points are displaced from their own true places. Grids span
{EXTENT:g} m: {grids}; methods without a grid thin the scans to {VOXEL:g} m.

{listed}{absent}"""


def remarks(rows: Sequence[Row]) -> str:
    """Overlap, pairs and drift of every run, and the order of the maps."""
    pairs, poses = by_run(rows, PAIR), by_run(rows, POSE)
    lines = [f"- {_run(run, some, ends(poses[run]))}" for run, some in pairs.items()]
    return "\n".join([_overlap(next(iter(pairs.values()))), "", *lines, "", _order(poses), "", _PLANES])


# What is not compared, whatever the rows
_PLANES = (
    "The paper draws the map by planes as patches, in which the three gates are sparse and the poles in front of them "
    "are missing (Figs. 28, 29). This is due to how that map is stored, not to the registration. All maps here consist "
    "of points."
)


def _overlap(pairs: Sequence[Row]) -> str:
    shares = [100 * column(pairs, name) for name in ("shared", "overlap")]
    shared, overlap = (f"{min(share):.0f} to {max(share):.0f} %" for share in shares)
    return (
        f"Of what a scan shows, {shared} is in view of the next or previous scan (the paper: an overlap of about 90 to "
        f"50 %). With noise and few beams, {overlap} of the points have a counterpart within 2 m in the other scan."
    )


def _run(run: Run, pairs: Sequence[Row], last: Sequence[Row]) -> str:
    good = right(pairs)
    text = f"**{label(*run)}**: {rate(good, pairs)} pairs are right"
    if good:
        text += f", with median errors of {middle(good, 'rotation_deg'):.2f}° and {middle(good, 'translation_m'):.2f} m"
    drift = _listed([f"{float(row['translation_m']):.2f} m / {float(row['rotation_deg']):.1f}°" for row in last])
    return f"{text}. The last pose of the chain is off by {drift}. {_wrong(wrong(pairs))}."


def _wrong(pairs: Sequence[Row]) -> str:
    """The wrong pairs by name, with their overlap, and how many of them were accepted."""
    if not pairs:
        return "No pair is wrong"
    shown = [
        f"{int(row['scan']) - 1} → {row['scan']} of seed {row['seed']} ({100 * float(row['shared']):.0f} % shared view)"
        for row in pairs[:6]
    ]
    more = f" and {len(pairs) - 6} more" if len(pairs) > 6 else ""
    return f"Wrong: {_listed(shown)}{more}. Accepted though wrong: {len(accepted(pairs))} of {len(pairs)}"


def _order(poses: dict[Run, list[Row]]) -> str:
    """Runs by the distance within which 90 % of their maps lie."""
    distance = {run: median(column(ends(some), MAP_90)) for run, some in poses.items()}
    floor = distance.pop((TRUTH, 0))
    listed = [f"{label(*run)} ({distance[run]:.2f} m)" for run in sorted(distance, key=lambda run: distance[run])]
    return (
        f"Methods by the distance within which 90 % of the map's points lie, best first: {_listed(listed)}; "
        f"with true poses {floor:.2f} m."
    )


def _listed(words: list[str]) -> str:
    return words[0] if len(words) == 1 else f"{', '.join(words[:-1])} and {words[-1]}"
