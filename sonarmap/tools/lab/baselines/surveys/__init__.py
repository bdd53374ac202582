"""Other systems that map a whole survey.

In: the scans in their order, a voxel. Out: a `SlamRun`: poses, and the pairs that were tried.
"""
