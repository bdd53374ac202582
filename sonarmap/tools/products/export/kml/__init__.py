"""KML and KMZ: the track and the map as a picture, for Google Earth and the like.

In: a part of a map on the Earth. Out: a document (`document.py`), pictures with their places (`overlay.py`), files.
"""
