"""The pair set in words."""

from collections.abc import Sequence

from sonarmap.tools.lab.evaluate.trajectory import RIGHT_DEG, RIGHT_VOXELS
from sonarmap.tools.lab.reproduce.evaluation.calibration_tables import calibration_table, reliability_table
from sonarmap.tools.lab.reproduce.evaluation.methods import OURS
from sonarmap.tools.lab.reproduce.experiment import Row, Section
from sonarmap.tools.lab.reproduce.pairs.figure import NEES, OVERLAP, PROBABILITY
from sonarmap.tools.lab.reproduce.pairs.settings import PairsSettings
from sonarmap.tools.lab.reproduce.pairs.tables import (
    accuracy_table,
    overlap_table,
    scene_table,
    trust_table,
    verdict_table,
)
from sonarmap.tools.lab.reproduce.rows import where


def pairs_section(rows: Sequence[Row], settings: PairsSettings) -> Section:
    """The requirements on ours, then every method's success and acceptance, then the calibration of ours."""
    methods = settings.compared.methods
    yaw, free = where(rows, turn="yaw"), where(rows, turn="any")
    tables = [
        verdict_table(yaw, free),
        overlap_table(yaw, methods, "Right registrations by overlap: any yaw, tilt up to 35 degrees"),
        overlap_table(free, methods, "Right registrations by overlap: any rotation"),
        trust_table(yaw, methods, "What each method accepts: any yaw, tilt up to 35 degrees"),
        trust_table(free, methods, "What each method accepts: any rotation"),
        scene_table(yaw, methods),
        accuracy_table(yaw, methods),
        calibration_table(yaw, free, methods),
        reliability_table(yaw, free),
    ]
    pictures = {
        OVERLAP: f"Share of right registrations against the overlap. The band is the 95 % interval of `{OURS}`."
    }
    if OURS in methods:
        pictures |= {
            NEES: f"Normalized squared errors of the right registrations of `{OURS}`, and the chi-squared density.",
            PROBABILITY: f"How often `{OURS}` is right against the probability it reports. The numbers are counts of "
            "registrations.",
        }
    return Section(
        title="Pairs of every overlap",
        introduction=_introduction(rows, settings),
        tables=tuple(table for table in tables if table.rows or table is tables[0]),
        times=(),
        pictures=pictures,
    )


def _introduction(rows: Sequence[Row], settings: PairsSettings) -> str:
    available = {turn: len({row["number"] for row in where(rows, turn=turn)}) for turn in settings.counts}
    short = [
        f"{count - available[turn]} of {count} ({turn})"
        for turn, count in settings.counts.items()
        if available[turn] < count
    ]
    peers = {min(settings.registers(method, turn) for method in settings.compared.methods) for turn in settings.counts}
    fewer = ""
    if min(peers) < min(settings.counts.values()):
        numbers = " and ".join(str(n) for n in sorted(peers, reverse=True))
        fewer = f" The methods other than `{OURS}` register only the first {numbers} of these pairs."
    scenes = ", ".join(f"`{scene}`" for scene in dict.fromkeys(row["scene"] for row in rows))
    return (
        f"{available['yaw']} pairs whose source is turned by any yaw and tilted by up to 35 degrees of roll and pitch, "
        f"and {available['any']} pairs whose source is turned by any rotation (for these, `{OURS}` runs without its "
        f"limit on roll and pitch; the other methods run unchanged). The scenes are {scenes}; each pair has a "
        f"scene seed of its own (set {settings.seed}). The scans of a pair share 5 to 100 % of their points, with "
        "equally many pairs in each fifth. The variance of the range noise is 0, 1 or 2 m² at the largest range of a "
        "scene of 256 m, and less in smaller scenes; there are also outliers, dropouts, ghosts and speckle. The grid "
        f"has {settings.edge} voxels along each edge; their size is chosen from the two scans. A registration is right "
        f"if it is within {RIGHT_DEG:g} degrees and {RIGHT_VOXELS:g} voxels of the truth. {settings.compared.words}"
        f"{fewer}" + (f" Left out, because the scene has no such pair: {', '.join(short)}." if short else "")
    )
