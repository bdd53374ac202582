"""The paper's chain: yaw, then roll and pitch, then the translation, each read off a correlation.

In: two scans prepared by `HemisphereRegistrar`. Out: a `Registration`. `layers.py` resamples and correlates hemisphere
layers; `registration.py` runs the steps of Sect. 2.11; `match.py` decides whether to believe the result.
"""
