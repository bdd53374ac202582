"""Dense streams: which scans are key scans, and where those between them are.

In: scans, and who registers pairs. Out: key scans, and after the decision about these the poses of all scans.
"""
