"""Dense streams: the choice of key scans, and the poses of the scans between them.

In: scans and a `PairRunner`. Out: key scans and, after the decision about these, the poses of all scans.
"""
