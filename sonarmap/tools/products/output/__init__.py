"""The folder that `sonarmap map` writes: its maps, graph, pairs.csv, summary.json, times.json, and files of lines.

In: the mapper's result. Out: files, all together or none.
"""
