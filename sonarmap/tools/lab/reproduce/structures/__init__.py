"""What the experiments on whole structures share (Sect. 3 of the paper, Figs. 7 to 17).

In: scenes, noises of the voxels, motions. Out: rows of the paper's registration of a structure to itself, moved.
"""
