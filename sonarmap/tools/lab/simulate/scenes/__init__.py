"""One file per scene: from a seed to its mesh. `catalog.py` lists them, `scene.py` casts rays at one."""
