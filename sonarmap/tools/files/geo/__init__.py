"""Where a map lies on the Earth: from the map's frame to latitude and longitude, to a projection, and back.

In: points in meters, or degrees. Out: the other. pyproj computes; here is what it is asked.
"""
