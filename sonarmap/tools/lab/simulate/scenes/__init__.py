"""One file per scene, and bed.py for all open beds: from a seed to a mesh.

`catalog.py` lists them, `scene.py` casts rays at one.
"""
