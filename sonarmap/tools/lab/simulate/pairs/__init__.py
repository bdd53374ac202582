"""Pairs of scans with a wanted overlap, rotation and noise, or with nothing in common, and the truth between them."""
