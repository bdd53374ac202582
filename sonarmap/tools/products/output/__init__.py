"""The folder that `sonarmap map` writes: which files, and what is in pairs.csv, summary.json and times.json.

In: the mapper's result. Out: files, all together or none.
"""
