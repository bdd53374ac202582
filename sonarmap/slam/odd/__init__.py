"""Faulty scans: mirrored, in another unit, or in another scale.

In: registered pairs, and a runner that registers more. Out: the faulty scans, each with the change with which it fits,
and a group of scans whose ranges are longer or shorter than those of the others.
"""
