"""Clusters of this machine, and what passes through them."""
