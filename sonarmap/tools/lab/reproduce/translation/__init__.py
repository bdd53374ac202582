"""Structures shifted out of the frame under noise of the voxels (Sect. 3, Figs. 12, 14, 15)."""
