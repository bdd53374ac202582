"""Kinds of scans that come from whole views of a 3D sonar: distorted, sparse, in motion, or several in a patch.

In: a pair's number and seed, a scene, the wanted overlap. Out: a `KindPair`.
"""
