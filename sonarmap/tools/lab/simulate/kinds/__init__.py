"""Simulated pairs of scans by kind: distorted single views, patches, swaths, stacked images and profiler sweeps.

In: a kind, a number and a seed. Out: a `KindPair`: two scans, their true poses and their overlap.
"""
