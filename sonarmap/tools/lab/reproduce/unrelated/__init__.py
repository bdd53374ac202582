"""Pairs that share nothing, by every method: what is accepted is wrong."""
