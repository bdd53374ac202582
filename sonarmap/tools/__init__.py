"""Everything that touches the world, in wings, each built on those before it.

`files`: what a file says and gets. `methods`: which methods of registration there are. `products`: what becomes of a
finished map. `lab`: simulator, scores, experiments, benchmarks. `command`: what the user asks for.
"""

try:
    import lazy_loader
except ImportError:  # `sonarmap doctor`, which starts here, is to say what is missing
    pass
else:
    __getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
