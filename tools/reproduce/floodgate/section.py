"""What the flood gate's maps say to people."""

from collections.abc import Mapping, Sequence

from tools.evaluate.trajectory import RIGHT_DEG
from tools.reproduce.experiment import Outcome, Section
from tools.reproduce.floodgate.chain import RIGHT_M, chains
from tools.reproduce.floodgate.figure import PICTURES
from tools.reproduce.floodgate.methods import COMPARED, EXTENT, VOXEL
from tools.reproduce.floodgate.remarks import remarks
from tools.reproduce.floodgate.tables import map_table, pair_table, pose_table, seeds_of
from tools.reproduce.floodgate.times_table import times_tables
from tools.reproduce.floodgate.verdict_table import AS_GOOD, CLEARLY, GOOD_M, verdict_table


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
kind, seen by a sensor like the Tritech Eclipse on a way before the gate, with a true pose for every scan and a true
surface for every point. Every scan is registered to the one before it by every method, none of them told anything of
the motion; a map is what chaining these makes, each registration taken as it is, whether its method believes it or
not, and the first scan lies where it truly was. There is no loop closure and no SLAM, as in the paper. Surveys: seeds
{named}; each has a bed, a sea and a noise of its own.

A pair is right within {RIGHT_DEG:g}° and {RIGHT_M:g} m at the sensor, for every method alike. A map is judged by the
distances of its points, all of them, to the true surface (point to triangle, exact), beside those of the map with true
poses, which only the noise makes. It corresponds to the truth where 90 % of its points lie at most {GOOD_M:g} m, the
paper's finer voxel, farther from it than with true poses; it is at least as good as another where that distance is at
most {AS_GOOD:g} times the other's, and clearly better at {CLEARLY:g} times. The bars were set before any run. What is
moved along the bed still lies on it: how far points are displaced from their own places stands in the table. Grids
span {EXTENT:g} m: {grids}; methods without a grid thin the scans to {VOXEL:g} m.

{listed}{absent}"""
