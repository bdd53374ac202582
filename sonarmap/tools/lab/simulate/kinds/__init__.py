"""Pairs of scans of every kind that surveys bring home, not only the single view of a still sonar.

In: a kind, a number and a seed. Out: a `KindPair`: two scans, the truth between them, and what they share.
"""
