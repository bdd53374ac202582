"""Scans whose axes or lengths do not go with those of their neighbors.

In: consecutive scans, registered, and who registers pairs. Out: the scans that fit once they are mirrored or scaled,
each with what it takes.
"""
