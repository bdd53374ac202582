"""Noisy 3D sonar scans in, a consistent map out: the names that a program needs.

    import sonarmap
    registration = sonarmap.register(target, source)  # two (N, 3) arrays of points [m]
    result = sonarmap.map_scans("scans/")

Names only: `__init__.pyi` lists them. Each is loaded when it is first used, so that `import sonarmap` takes no time.
"""

try:
    import lazy_loader
except ImportError as _error:  # the command imports this too, and `sonarmap doctor` is to say what is missing
    _missing = str(_error)

    def __getattr__(name: str) -> object:
        if name.startswith("_"):
            raise AttributeError(name)
        raise ImportError(f"sonarmap lacks a library: {_missing}. 'sonarmap doctor' says what to do")
else:
    __getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
