"""Noisy 3D sonar scans in, a consistent map out: the names that a program needs.

    import sonarmap
    registration = sonarmap.register(target, source)  # two (N, 3) arrays of points [m]
    result = sonarmap.map_scans("scans/")

Names only: `__init__.pyi` lists them. Each is loaded when it is first used, so that `import sonarmap` takes no time.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
