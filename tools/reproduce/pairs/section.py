"""The pair set in words."""

from collections.abc import Sequence

from tools.evaluate.trajectory import RIGHT_DEG, RIGHT_VOXELS
from tools.reproduce.evaluation.calibration_tables import calibration_table, reliability_table
from tools.reproduce.evaluation.methods import OURS
from tools.reproduce.experiment import Row, Section
from tools.reproduce.pairs.figure import NEES, OVERLAP, PROBABILITY
from tools.reproduce.pairs.settings import PairsSettings
from tools.reproduce.pairs.tables import accuracy_table, overlap_table, scene_table, trust_table, verdict_table
from tools.reproduce.rows import where


def pairs_section(rows: Sequence[Row], settings: PairsSettings) -> Section:
    """What is wanted of ours, then every method's success and trust, then how honest ours is."""
    methods = settings.compared.methods
    yaw, free = where(rows, turn="yaw"), where(rows, turn="any")
    tables = [
        verdict_table(yaw, free),
        overlap_table(yaw, methods, "Right by overlap: any yaw, tilt up to 35 degrees"),
        overlap_table(free, methods, "Right by overlap: any rotation"),
        trust_table(yaw, methods, "What each method believes: any yaw, tilt up to 35 degrees"),
        trust_table(free, methods, "What each method believes: any rotation"),
        scene_table(yaw, methods),
        accuracy_table(yaw, methods),
        calibration_table(yaw, free, methods),
        reliability_table(yaw, free),
    ]
    pictures = {OVERLAP: f"Share of right registrations over the share in common; of `{OURS}` with Wilson's 95 % band."}
    if OURS in methods:
        pictures |= {
            NEES: f"Normalized squared errors of the right registrations of `{OURS}` beside chi-squared.",
            PROBABILITY: f"How often `{OURS}` is right, over the probability that it tells; numbers of registrations.",
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
        fewer = f" Those beside `{OURS}` register the first {numbers} of them."
    scenes = ", ".join(f"`{scene}`" for scene in dict.fromkeys(row["scene"] for row in rows))
    return (
        f"{available['yaw']} pairs whose source is turned by any yaw and tilted by up to 35 degrees of roll and pitch, "
        f"and {available['any']} others turned by any rotation ({OURS} with its bound on roll and pitch lifted, the "
        f"other methods as they are), from scenes of {scenes}, each with a seed of its own (set {settings.seed}). They "
        "share 5 to 100 % of their points, as many pairs in each fifth; the range noise is 0, 1 or 2 m² at the largest "
        "range of a scene of 256 m, smaller in smaller scenes, with outliers, dropouts, ghosts and speckle. The grid "
        f"has {settings.edge} voxels an edge, their size chosen from the two scans; right is within {RIGHT_DEG:g} "
        f"degrees and {RIGHT_VOXELS:g} voxels. {settings.compared.words}{fewer}"
        + (f" Pairs that their scenes do not have are left out: {', '.join(short)}." if short else "")
    )
