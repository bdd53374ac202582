"""OpenCL devices, programs and launches.

In: a selector such as "gpu" or "0:0". Out: a `Device`, which holds the context, the queue and its
programs. `launch.py` is what every kernel's Python function shares: it checks arrays and enqueues kernels.
"""
