"""Every method of registration by its name, and a fingerprint of what decides its results.

`registry.py` builds a method from its name and a `Setup`, and keeps the last one ready; a new method is a row of its
table. `fingerprint.py` gives digests of code, settings, device and versions, under which journals keep results, and
says what other processes make a method from.
"""
