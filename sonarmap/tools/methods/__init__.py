"""The registration methods by name, and fingerprints of everything that affects their results.

`registry.py` builds a method from its name and a `Setup`, and keeps the last one for reuse; a new method is a row of
its table. `fingerprint.py` computes digests of code, settings, device and versions, which are the keys of journals, and
the specification from which worker processes build a method.
"""
