"""Ranges that are wrong all alike: by a factor, as with a wrong sound speed, or by a constant.

A sonar multiplies half the travel time by a sound speed. Set to 1,500 m/s it is wrong by 2 % in water of 1,470 or
1,530 m/s: 6 to 7 degrees Celsius, or 22 parts per thousand of salt, away from where it was right (H. Medwin, Speed of
sound in water: a simple equation for realistic parameters, 1975, doi 10.1121/1.380790). A constant is added by the
delay of the electronics, by where on the sensor a range counts from, and by where on a pulse's echo the detector
triggers: a pulse of 0.3 ms is 23 cm long. Calibrated sonars are better than the 1 % of the maximum range drawn here.
"""

from sonarmap.spectral.scan import Scan
from sonarmap.tools.lab.simulate.kinds.kind import KindPair
from sonarmap.tools.lab.simulate.kinds.views.single_view import Shot, distorted_scan, single_view_pair

SPEED_ERROR = 0.02  # greatest relative error of the sound speed, each scan's its own
MOST_BIAS = 0.01  # greatest constant either way, in shares of the maximum range, each scan's its own


def sound_speed_pair(number: int, seed: int, scene: str, overlaps: tuple[float, float]) -> KindPair:
    """A builder of SCAN_KINDS: all ranges too long or too short by up to 2 %.

    Raises:
        InputError: the scene has no such pair.
    """
    return single_view_pair("sound_speed", number, seed, scene, overlaps, scaled_scan)


def range_bias_pair(number: int, seed: int, scene: str, overlaps: tuple[float, float]) -> KindPair:
    """A builder of SCAN_KINDS: all ranges too long or too short by up to 1 % of the maximum range.

    Raises:
        InputError: the scene has no such pair.
    """
    return single_view_pair("range_bias", number, seed, scene, overlaps, shifted_scan)


def scaled_scan(shot: Shot) -> Scan:
    """What a sonar with a wrong sound speed writes down of a view."""
    factor = 1 + shot.distortion.uniform(-SPEED_ERROR, SPEED_ERROR)
    return distorted_scan(shot, lambda ranges: factor * ranges)


def shifted_scan(shot: Shot) -> Scan:
    """What a sonar whose ranges are all off by one length writes down of a view."""
    bias = shot.observer.sensor.max_range * shot.distortion.uniform(-MOST_BIAS, MOST_BIAS)
    return distorted_scan(shot, lambda ranges: ranges + bias)
