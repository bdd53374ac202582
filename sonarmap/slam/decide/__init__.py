"""Which registrations to believe: consistency, outlier rejection, verdicts.

In: registered pairs. Out: a `Decision` with the optimized graph and every pair with its reason. `decision.py` has the
steps; answers that agree with each other are found in `consistency.py`, outliers of a graph in `robust.py`.
"""
