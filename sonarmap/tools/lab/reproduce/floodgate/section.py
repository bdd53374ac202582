"""The flood gate's maps in words and tables."""

from collections.abc import Mapping, Sequence

from sonarmap.tools.lab.evaluate.trajectory import RIGHT_DEG
from sonarmap.tools.lab.reproduce.experiment import Outcome, Section
from sonarmap.tools.lab.reproduce.floodgate.chain import RIGHT_M, chains
from sonarmap.tools.lab.reproduce.floodgate.figure import PICTURES
from sonarmap.tools.lab.reproduce.floodgate.methods import COMPARED, EXTENT, VOXEL
from sonarmap.tools.lab.reproduce.floodgate.remarks import remarks
from sonarmap.tools.lab.reproduce.floodgate.tables import map_table, pair_table, pose_table, seeds_of
from sonarmap.tools.lab.reproduce.floodgate.times_table import times_tables
from sonarmap.tools.lab.reproduce.floodgate.verdict_table import AS_GOOD, CLEARLY, GOOD_M, verdict_table


def floodgate_section(
    methods: Sequence[str], missing: Sequence[str], edges: Sequence[int], outcomes: Mapping[str, Outcome]
) -> Section:
    """The section, from the rows of all jobs.

    Args:
        methods: keys of COMPARED that ran.
        missing: those that were left out because their packages are not installed.
        edges: voxels per edge of the grids.
        outcomes: of all jobs.
    """
    made = chains(outcomes)
    return Section(
        title="A flood gate, eighteen scans: Sect. 4, Table 2, Figs. 22 to 31",
        introduction=_introduction(methods, missing, edges, seeds_of(made)),
        tables=(verdict_table(made), map_table(made), pair_table(made), pose_table(made)),
        times=times_tables(outcomes),
        pictures=PICTURES,
        remarks=remarks(made),
    )


def _introduction(methods: Sequence[str], missing: Sequence[str], edges: Sequence[int], seeds: Sequence[int]) -> str:
    grids = " and ".join(f"{edge}³ ({EXTENT / edge:g} m)" for edge in edges)
    listed = "\n".join(f"- **{name}**: {COMPARED[name].title}" for name in COMPARED if name in methods)
    absent = f"\n\nNot installed, so left out: {', '.join(missing)}." if missing else ""
    named = ", ".join(map(str, seeds))
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
