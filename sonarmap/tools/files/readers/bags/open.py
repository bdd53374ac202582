"""Opens recordings of every format."""

from collections.abc import Callable
from pathlib import Path

from sonarmap.tools.files.readers.bags.folder import open_folder
from sonarmap.tools.files.readers.bags.mcap_file import open_mcap
from sonarmap.tools.files.readers.bags.recording import Recording
from sonarmap.tools.files.readers.bags.ros1_file import open_ros1
from sonarmap.tools.files.readers.bags.sqlite_file import open_sqlite
from sonarmap.tools.files.readers.selection import is_bag_folder

RECORDINGS: dict[str, Callable[[Path], Recording]] = {".bag": open_ros1, ".mcap": open_mcap, ".db3": open_sqlite}


def is_recording(path: Path) -> bool:
    """Whether a file is a recording by its suffix, or a folder is a ROS 2 bag."""
    return path.suffix.lower() in RECORDINGS or is_bag_folder(path)


def open_recording(path: Path, notes: list[str]) -> Recording:
    """The recording of a file that `is_recording`, or of a folder; notes about it are added to the list. Raises
    InputError: it is damaged, or there is no message in it."""
    return open_folder(path, notes) if path.is_dir() else RECORDINGS[path.suffix.lower()](path)
