"""Registration by plane patches, as the paper compares it in Sect. 4.3 (Pathak et al. 2010).

In: scans. Out: a `Registration`. `fit.py` fits a plane, `extraction.py` finds a scan's patches, `matching.py` the
largest set of pairs that one transform brings together, `pose.py` that transform; `registrar.py` puts it together and
decides whether to accept it.
"""
