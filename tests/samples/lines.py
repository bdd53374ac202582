"""Simulated lines of an echo sounder as files."""

from pathlib import Path

import numpy as np

from sonarmap.slam.pings.line import PingLine
from sonarmap.tools.files.geo import Georeference
from tests.tools.files.readers.pings.samples import START, Sample, write_gsf

HERE = Georeference(58.1234, -11.6543)


def sample_of(line: PingLine) -> Sample:
    """A line with equally many soundings per ping, around the place HERE, from the time START on."""
    shape = (len(line.stamps), -1, 3)
    return Sample(
        stamps=START + line.stamps - 1e6,
        fixes=HERE.geodetic(line.places)[:, :2],
        attitudes=np.degrees(line.attitudes),
        heave=np.zeros(len(line.stamps)),
        points=((line.points + [0, 0, 1] * line.places[line.pings]) * [1, -1, -1]).reshape(shape),
        rejected=np.zeros((len(line.stamps), len(line.points) // len(line.stamps)), bool),
    )


def gsf_of(path: Path, line: PingLine) -> Path:
    """Write a line as GSF."""
    return write_gsf(path, sample_of(line))
