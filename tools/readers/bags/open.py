"""Opens recordings of every format."""

from collections.abc import Callable
from pathlib import Path

from tools.readers.bags.folder import open_folder
from tools.readers.bags.mcap_file import open_mcap
from tools.readers.bags.recording import Recording
from tools.readers.bags.ros1_file import open_ros1
from tools.readers.bags.sqlite_file import open_sqlite
from tools.readers.selection import is_bag_folder

RECORDINGS: dict[str, Callable[[Path], Recording]] = {".bag": open_ros1, ".mcap": open_mcap, ".db3": open_sqlite}


def is_recording(path: Path) -> bool:
    """Whether a file is a recording by its suffix, or a folder is a ROS 2 bag."""
    return path.suffix.lower() in RECORDINGS or is_bag_folder(path)


def open_recording(path: Path, notes: list[str]) -> Recording:
    """The recording of a file that `is_recording`, or of a folder; notes about it are added to the list.

    Raises:
        InputError: it is damaged, or there is no message in it.
    """
    return open_folder(path, notes) if path.is_dir() else RECORDINGS[path.suffix.lower()](path)
