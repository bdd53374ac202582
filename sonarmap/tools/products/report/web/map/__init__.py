"""The map in 3D: what is drawn, how it follows mouse, fingers and keys, what is picked, and the form beside it.

Only `packed.js` knows the layout of the bytes; only `scene.js` and `shaders.js` know WebGL.
"""
