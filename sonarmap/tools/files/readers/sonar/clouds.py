"""Recordings of the Water Linked Sonar 3D-15 (.sonar): one scan per range image, strengths from its twin."""

from collections.abc import Iterator
from pathlib import Path

from sonarmap.kernels.errors import InputError
from sonarmap.tools.files.readers.clouds.cloud import Cloud
from sonarmap.tools.files.readers.sonar.recording import Recording


def stream_sonar(path: Path, notes: list[str]) -> Iterator[Cloud]:
    """One cloud per range image, in the order of the shots; one without an echo is empty.

    What is lost, doubled, damaged or out of order leaves a gap, and is added to the notes when all is read.

    Raises InputError: the file cannot be read, or holds no good range image.
    """
    recording = Recording()
    for shot in recording.read(path):
        frame = shot.frame
        yield Cloud(
            frame.points,
            shot.strength,
            frame.stamp,
            prior=recording.imu.prior_at(frame.stamp),
            sound_speed=frame.sound_speed,
        )
    if not recording.shots:
        first = recording.damage.first
        raise InputError(
            f"no range image can be read; {first}: copy the recording again"
            if first
            else f"no range image among its {recording.packets:,} packets; record with range images enabled"
        )
    notes += [f"{path.name}: {note}" for note in recording.notes(path.stat().st_mtime)]
