"""The vehicle's motion from scan to scan.

In: accepted registrations of consecutive scans, and their stamps. Out: expected poses of scans, and the registrations
that contradict them.
"""
