"""Which registrations to use: consistency, outlier rejection, verdicts.

In: registered pairs. Out: a `Decision` with the optimized graph and every pair with its reason. `decision.py` has the
steps; `consistency.py` finds hypotheses that agree with each other, `robust.py` the outliers of a graph.
"""
