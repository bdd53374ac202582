"""Locate scans in a finished map: candidates by appearance, registered, checked against the map's points.

`surveyed_map.py` holds the map and its views from poses, `place.py` the places and results, `locator.py` the method.
"""
