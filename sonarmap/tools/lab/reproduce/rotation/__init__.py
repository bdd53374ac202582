"""Structures turned under noise of the voxels (Sect. 3, Figs. 16, 17)."""
