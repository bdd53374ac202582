"""Whole structures, moved under noise of the voxels (Sect. 3 of the paper, Figs. 7 to 17).

`moved.py` registers a structure to itself, shifted or turned; `limits.py` looks at each step under tilt.
"""
