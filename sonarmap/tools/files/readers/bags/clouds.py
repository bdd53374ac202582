"""Clouds of a ROS bag or MCAP file: one per message of a topic."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np

from sonarmap.kernels.errors import InputError
from sonarmap.tools.files.readers.bags.cloud_message import CLOUD_KINDS, cloud_of, moved
from sonarmap.tools.files.readers.bags.frames import Frames
from sonarmap.tools.files.readers.bags.open import open_recording
from sonarmap.tools.files.readers.bags.recording import choose_topic
from sonarmap.tools.files.readers.clouds.cloud import Cloud

_NAMED = 3  # faults that are named


def stream_recording(path: Path, topic: str | None, notes: list[str]) -> Iterator[Cloud]:
    """The clouds of a topic, one per message, stamped by their headers.

    They are in base_link where tf_static has the sensor's mounting, and else in the sensor's frame. A message that
    cannot be used is an empty cloud.

    Args:
        topic: None for the only one with clouds.

    Raises InputError: no such topic, several of which none is named, or none of its messages can be used.
    """
    about: list[str] = []
    recording = open_recording(path, about)
    chosen = choose_topic(recording, topic, CLOUD_KINDS, path)
    frames, faults = Frames(recording), list[str]()
    usable = unstamped = 0
    for number, message in enumerate(recording.messages([chosen.name], faults)):
        try:
            stamped = cloud_of(message)
            cloud = moved(stamped.cloud, frames.T_base(stamped.frame))
        except InputError as error:
            faults.append(f"message {number} of {chosen.name}: {error}")
            yield Cloud(np.empty((0, 3), np.float32), stamp=message.time / 10**9)
            continue
        usable += 1
        unstamped += cloud.stamp is None
        yield replace(cloud, stamp=message.time / 10**9) if cloud.stamp is None else cloud
    if not usable:
        raise InputError(faults[0] if faults else f"no message of {chosen.name} can be read; record it again")
    if unstamped:
        frames.notes.append(f"{unstamped:,} headers have no stamp: the times are those at which they were recorded")
    once = dict.fromkeys(about + _shortened(frames.notes) + _shortened(faults))  # damage that both passes met
    notes += [f"{path.name}: {note}" for note in once]


def _shortened(notes: list[str]) -> list[str]:
    return [*notes[:_NAMED], f"and {len(notes) - _NAMED:,} more of these"] if len(notes) > _NAMED + 1 else notes
