"""Scans whose axes or lengths do not go with those of their neighbors.

In: registered pairs, and who registers more. Out: the scans that fit once they are mirrored or scaled, each with what
it takes, and a group of scans whose ranges are longer or shorter than the others'.
"""
