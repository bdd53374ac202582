"""What a whole method of mapping, not one of pairs, makes of a survey."""

from dataclasses import dataclass

from sonarmap.slam.graph.trajectory import Trajectory
from sonarmap.tools.files.map_folder.pairs import TriedPair


@dataclass(frozen=True, slots=True)
class SlamRun:
    """Poses of the scans that the method could use.

    Attributes:
        trajectory: with the scans' stamps, in a world of its own.
        pairs: of scans that it registered, kept or not; none where it does not work on pairs of scans.
        loops: how many loop closures it kept.
        seconds: wall time, from the first scan to the last pose.
    """

    trajectory: Trajectory
    pairs: tuple[TriedPair, ...]
    loops: int
    seconds: float
