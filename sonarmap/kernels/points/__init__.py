"""Points on the device: voxelize them, or compare them with range images of another scan.

In: points (n, 4) or (3, n) float32 in voxels. Out: a volume, or how many points agree with a range image.
"""
