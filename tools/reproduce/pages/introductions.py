"""How the page of each group of experiments begins."""

PAPER_INTRODUCTION = """# The paper's experiments, reproduced

Bülow and Birk, "Spectral registration of noisy sonar data for underwater 3D mapping", Autonomous Robots 30, 2011, doi
10.1007/s10514-011-9221-8. The paper tests translation, rotation and both together on a simulated scene with four kinds
of noise (Sect. 3), and makes a map of eighteen scans of the Lesumer Sperrwerk, a flood gate near Bremen, taken with a
Tritech Eclipse sonar (Sect. 4). It gives neither the scene nor the scans. So all scans here are simulated, those of
Sect. 4 too: of a flood gate and of clutter (`sonarmap simulate`; `--scene` takes others), with the paper's field of
view, steps and noise, and with a truth for every pose. What the paper reports on its scans stands beside what this
project finds on these: claims can be reproduced so, single numbers cannot.

This page and its pictures are made by the commands below, each of which goes on where it was stopped; `--page FILE`
writes the page from what is found in the folder of results. With the same seeds, code, device and versions the rows,
tables and pictures come out the same byte by byte; only the times differ. Rates have Wilson's 95 % intervals.
"""

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

SLAM_INTRODUCTION = """# Mapping whole surveys

How mapping does, from scans to one map, beside other systems: simulated surveys (`sonarmap simulate`), with a truth for
every pose and every surface. All systems are given the same scans, and each has its defaults.

This page and its pictures are made by the commands below, each of which goes on where it was stopped; `--page FILE`
writes the page from what is found in the folder of results. With the same seeds, code, device and versions the rows,
tables and pictures come out the same byte by byte; only times and memory differ.
"""
