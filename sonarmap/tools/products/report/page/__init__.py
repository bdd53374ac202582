"""report.html: one page with the map in 3D and all that a survey says of itself, read from disk without a network.

In: the folder that `sonarmap map` wrote. Out: one file. `content.py` gathers, `points.py` packs the points, and
`page.py` joins them with what is in `web`, by `parts.py`, which other pages use, too.
"""
