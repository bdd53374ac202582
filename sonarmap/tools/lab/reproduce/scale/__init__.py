"""How the mapper grows with the number of scans, with made-up registrations.

In: a number of scans. Out: CPU seconds and memory by stage, and how far off the poses are.
"""
