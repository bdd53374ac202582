"""report.html, one page with the map in 3D and all that a survey says of itself, and pictures as PNG files.

In: the folder that `sonarmap map` wrote, or the result. Out: files that need no network. `content.py` gathers,
`points.py` packs the points, and `page.py` joins them with what is in `web`, which other pages use, too.
"""
