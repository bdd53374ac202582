"""Trajectories of either format, told apart by what the file holds."""

from pathlib import Path

from kernels.errors import InputError
from slam.trajectory import Trajectory
from tools.readers import kitti, tum
from tools.readers.pose_rows import read_lines

_KITTI_COLUMNS = len(kitti.LAYOUT.split())


def read_pair(estimate: Path, truth: Path) -> tuple[Trajectory, Trajectory]:
    """Two trajectories whose poses belong together: by stamp in TUM files, by line in KITTI files.

    A file is KITTI where its suffix says so or its first line has twelve columns; any other is taken for TUM.

    Raises:
        InputError: naming the file and the line that is not as it should be; or only one of the two has stamps.
    """
    stamped = [not _is_kitti(path) for path in (estimate, truth)]
    if stamped[0] != stamped[1]:
        with_stamps, without = (estimate, truth) if stamped[0] else (truth, estimate)
        raise InputError(
            f"{without} is a KITTI file, whose poses have no stamps, and {with_stamps} is none: which poses belong "
            "together cannot be told. Give two files of one format."
        )
    read = tum.read_tum if stamped[0] else kitti.read_kitti
    return read(estimate), read(truth)


def _is_kitti(path: Path) -> bool:
    return path.suffix.lower() == ".kitti" or len(read_lines(path)[0][1].split()) == _KITTI_COLUMNS
