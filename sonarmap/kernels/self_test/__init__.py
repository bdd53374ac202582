"""Whether a device's numbers are right, which is found out before it is believed.

In: a `Device`. Out: for each check, how far the device is from NumPy or from the truth, and how far it may be
(`checks.py`); what it said is remembered until its driver or sonarmap's kernels change (`device/trial.py`).
"""
