"""Where a scan was taken in a finished map: candidates by appearance, registered, checked against the map's points.

`surveyed_map.py` has the map and what is seen of it from a pose, `place.py` answers that agree, `locator.py` the
method, `located.py` what comes of it.
"""
