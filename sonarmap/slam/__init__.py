"""From scans to a map: the search for pairs, outlier rejection, pose graphs, and fusion.

In: scans (`spectral.scan.Scan`) and a method of registration. Out: a `SurveyResult` with poses, their covariances, the
pose graph, every pair with its verdict, and the fused maps. `mapper.py` has the steps in order; `pair.py` has the
stages of a pair from candidate to verdict. The only file here is the journal.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
