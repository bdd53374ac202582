"""Input, output and the command line, in packages of which each uses only those before it.

`files`: readers and writers of file formats. `methods`: the registration methods. `products`: exports, report and
comparison of finished maps. `lab`: simulator, scores, experiments, benchmarks. `command`: the command line.
"""

try:
    import lazy_loader
except ImportError:  # `sonarmap doctor` imports this package and reports what is missing
    pass
else:
    __getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
