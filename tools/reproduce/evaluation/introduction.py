"""What the page on the evaluation begins with."""

EVALUATION_INTRODUCTION = """# Evaluation on unseen pairs

How the registration does on pairs that nothing was chosen on: the scenes, poses and noises come from seeds that neither
development nor the tests use, so that what is found here is what a new pair may expect, as far as simulated scans can
tell. The same pairs, grids and criteria hold for every method; each has its defaults. All scans are simulated
(`sonarmap simulate`), with a truth for every pair.

This page and its pictures are made by the commands below, each of which goes on where it was stopped and does anew only
what a change of the code has touched; `--page FILE` writes the page from what is found in the folder of results. With
the same seeds, code, device and versions the rows, tables and pictures come out the same byte by byte, however many
`--workers` share the jobs; only the times differ. Rates have Wilson's 95 % intervals.
"""
