"""OpenCL devices, programs and launches.

In: a selector such as "gpu" or "0:0". Out: a `Device` with its context, queue and compiled programs. The Python
function of every kernel uses `launch.py` to check its arrays and enqueue the kernel.
"""
