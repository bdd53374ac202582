"""From scans to a map: pairs to register, which of them to believe, where the poses are, and the map.

In: scans (`spectral.scan.Scan`) and a method of registration. Out: a `SurveyResult` with poses, their covariances, the
pose graph, every pair with its verdict, and the fused maps. `mapper.py` has the steps in order; `pair.py` is two
scans from the candidate to the verdict. No file is read or written here but the journal, and
scans on their way to other processes.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
