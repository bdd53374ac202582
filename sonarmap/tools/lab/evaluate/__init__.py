"""How good a result is: trajectories, maps, pairs, uncertainties and place recognition compared with the truth.

In: an estimate and the truth, or the summary.json of a survey. Out: errors, scores and calibrations as numbers.
"""
