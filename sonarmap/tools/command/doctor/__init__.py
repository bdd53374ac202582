"""What is wrong with this machine or this installation, and what to do about it: `sonarmap doctor`.

In: the machine. Out: a `Finding` for each thing that was looked at. It has to work where the rest does not, so its
files import at their top nothing but the standard library and each other, and what a driver or a broken library can end
is tried in a process of its own (`child.py`).
"""
