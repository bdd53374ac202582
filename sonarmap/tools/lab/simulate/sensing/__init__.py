"""Simulated measurements: a sonar's echoes with multipath and noise, overlaps, priors of poses, dead reckoning."""
