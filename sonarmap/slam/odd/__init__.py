"""Faulty scans: mirrored, in another unit, or in another scale.

In: the decision about a survey, and a runner that registers more pairs. Out: the faulty scans, each with the change
with which it fits, and a group of scans whose ranges are longer or shorter than those of the others.
"""
