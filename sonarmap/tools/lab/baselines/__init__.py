"""Registration methods of others, for comparison.

Each method implements the protocol `spectral.result.Registrar`: `prepare` a scan, `register` two prepared scans.
`points.py` has the base class of the methods on points, with their covariance, overlap and acceptance; `icp.py` and
`features.py` have the methods.
"""
