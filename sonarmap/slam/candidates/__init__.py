"""Candidates for loop closures.

In: the outlines and signatures of the scans and the current estimate. Out: candidates (`Candidate`), best first.
"""
