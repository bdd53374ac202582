"""Evaluation against the truth: errors of trajectories and maps, scores of pairs, calibration of uncertainties.

In: an estimate and the truth, or the summary.json of a survey. Out: errors, scores and calibrations as numbers.
"""
