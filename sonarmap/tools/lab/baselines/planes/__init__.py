"""Registration by plane patches, as the paper compares it in Sect. 4.3 (Pathak et al. 2010).

In: scans. Out: a `Registration`. `extraction.py` finds the patches of a scan, `fit.py` their planes and covariances;
`candidates.py` pairs patches, `consensus.py` searches the largest set that one transform brings together, `pose.py`
computes that transform; `registrar.py` puts it together and decides whether to accept it.
"""
