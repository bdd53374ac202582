"""Navigation files (CSV, TUM, NMEA 0183): priors of scans and dead reckoning.

Rows of a file become measurements of the scans' poses, in UTC and in the map's frame, East-North-Up.
"""
