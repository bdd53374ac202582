"""What the page on mapping begins with."""

SLAM_INTRODUCTION = """# Mapping whole surveys

How mapping does, from scans to one map, beside other systems: simulated surveys (`sonarmap simulate`), with a truth for
every pose and every surface. All systems are given the same scans, and each has its defaults.

This page and its pictures are made by the commands below, each of which goes on where it was stopped; `--page FILE`
writes the page from what is found in the folder of results. With the same seeds, code, device and versions the rows,
tables and pictures come out the same byte by byte; only times and memory differ.
"""
