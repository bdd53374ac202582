"""report.html, one page with the map in 3D and the evidence for it, and pictures as PNG files.

In: the folder that `sonarmap map` wrote, or the result. Out: files that need no network. `content.py` collects the
content, `points.py` packs the points, and `page.py` joins them with the files of `web`, which other pages use, too.
"""
