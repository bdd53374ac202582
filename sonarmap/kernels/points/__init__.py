"""Points on the device: put into voxels, or compared with what another sensor saw.

In: points (n, 4) or (3, n) float32 in voxels. Out: a volume, or how many points agree with a range image.
"""
