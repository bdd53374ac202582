"""Pairs of real scans whose truth is known, by every method: what is right, what is believed, how far off it is.

In: a folder of scans with a gt.log, or of such folders. Out: rows, tables and figures as of every experiment.
"""
