"""A finished map in the formats of other programs.

In: the folder that `sonarmap map` wrote. Out: files for GIS, point-cloud and survey programs, each with a side-car.
"""
