"""How the vehicle moves from scan to scan.

In: registrations of consecutive scans that are sure, and their stamps. Out: where a scan is expected, and which
registrations contradict that.
"""
