"""Shared by tests of the simulator: a sensor of few beams, and no noise."""

import numpy as np

from sonarmap.tools.lab.simulate.sensing.noise import Noise
from sonarmap.tools.lab.simulate.sensing.sensors import Sensor

COARSE = Sensor("coarse", np.deg2rad(90), np.deg2rad(60), 33, 21, 0.5, 60.0)
QUIET = Noise()
