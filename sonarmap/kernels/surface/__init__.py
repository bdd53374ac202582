"""Points of surfaces in cells: which lies nearest, which planes they show, what two surfaces share, how they meet.

In: points, normals and poses. Out: neighbors, smoothed surfaces, shares, and the refined poses with the sums that their
fits are judged by. `cells.cl` holds the one search that all of them use.
"""
