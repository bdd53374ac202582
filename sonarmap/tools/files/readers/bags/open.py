"""Opens recordings of every format, ROS 2 bags that are folders too: metadata.yaml, and one file after another."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Collection, Iterator, Sequence
from functools import partial
from itertools import chain
from math import inf
from pathlib import Path, PurePath

from sonarmap.kernels.errors import InputError
from sonarmap.tools.files.readers.bags.mcap_file import open_mcap, open_ros1, open_sqlite
from sonarmap.tools.files.readers.bags.recording import Message, Recording, Room, topics_of
from sonarmap.tools.files.readers.selection import BAG_METADATA, BAG_TITLE, is_bag_folder
from sonarmap.tools.files.user_file import naming

_LARGEST = 1 << 18  # bytes of metadata, of which YAML reads 100 KB in a second
_COMPRESSED = (".zstd", ".zst")
# of a bag's files; a second argument is their bytes before they were unpacked
_OPENERS: dict[str, Callable[[Path, int | None], Recording]] = {".db3": open_sqlite, ".mcap": open_mcap}


def is_recording(path: Path) -> bool:
    """Whether a file is a recording by its suffix, or a folder is a ROS 2 bag."""
    return path.suffix.lower() in (".bag", *_OPENERS) or is_bag_folder(path)


def open_recording(path: Path, notes: list[str]) -> Recording:
    """The recording of a file that `is_recording`, or of a folder; notes about it are added to the list. Raises
    InputError: it is damaged, or there is no message in it."""
    if path.is_dir():
        return _open_folder(path, notes)
    suffix = path.suffix.lower()
    return open_ros1(path) if suffix == ".bag" else _OPENERS[suffix](path, None)


def _open_folder(folder: Path, notes: list[str]) -> Recording:
    """Of all files of a bag, in the order of their times; notes name those that are missing or left out."""
    files = _files_of(folder, notes)
    present = [file for file in files if file.is_file()]
    notes += [f"{file.name}, which {BAG_METADATA} names, is missing" for file in files if file not in present]
    if not present:
        raise InputError(f"none of its files is there, as {BAG_METADATA} names them; copy the whole folder")
    packed = [file.stat().st_size for file in present if file.suffix in _COMPRESSED]
    room = Room(sum(packed)) if packed else None
    parts = sorted((_open_part(file, room) for file in present), key=_start)
    counts = Counter[tuple[str, str]]()
    for topic in chain.from_iterable(part.topics for part in parts):
        counts[topic.name, topic.kind] += topic.count
    return Recording(topics_of(counts), partial(_messages, parts, room))


def _messages(
    parts: Sequence[Recording], _: Room | None, names: Collection[str], faults: list[str]
) -> Iterator[Message]:
    """The files that were unpacked stay for as long as this can be called."""
    for part in parts:
        yield from part.messages(names, faults)


def _open_part(file: Path, room: Room | None) -> Recording:
    with naming(file.name):
        plain = room.unpack(file) if room and file.suffix in _COMPRESSED else file
        return _OPENERS[plain.suffix](plain, file.stat().st_size)


def _start(part: Recording) -> float:
    """When its first message was recorded [ns since 1970]; what cannot be read comes last."""
    try:
        return next((message.time for message in part.messages([topic.name for topic in part.topics], [])), inf)
    except InputError:
        return inf


def _files_of(folder: Path, notes: list[str]) -> list[Path]:
    """As the metadata list them; those of the folder where the metadata do not."""
    there = sorted(filter(_is_recording, folder.iterdir()))
    listed = [file for file in _listed(folder) if _is_recording(file)]
    if not listed:
        notes.append(f"{BAG_METADATA} cannot be read; all recordings of the folder are taken")
        return there
    known = {_plain_name(file) for file in listed}  # a file may be there compressed and unpacked
    left = [file.name for file in there if _plain_name(file) not in known]
    notes += [f"{name} is left out, as {BAG_METADATA} does not name it" for name in left]
    return listed


def _listed(folder: Path) -> list[Path]:
    """Each once; none where the metadata cannot be read."""
    from ruamel.yaml import YAML

    try:
        text = (folder / BAG_METADATA).read_bytes()[:_LARGEST]
        names = YAML(typ="safe").load(text)[BAG_TITLE]["relative_file_paths"]
        return list(dict.fromkeys(folder / PurePath(name).name for name in names))
    except Exception:  # noqa: BLE001 - damage in YAML ends in errors of any kind
        return []


def _is_recording(file: Path) -> bool:
    return PurePath(_plain_name(file)).suffix in _OPENERS


def _plain_name(file: Path) -> str:
    return file.stem if file.suffix in _COMPRESSED else file.name
