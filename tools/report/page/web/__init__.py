"""The page itself: HTML, CSS and plain JavaScript, joined by `page.py` in the order of its `SCRIPTS`.

The scripts share one scope. Only `packed.js` knows the layout of the bytes; only `scene.js` and `shaders.js` know
WebGL; `elements.js` makes every element, and texts are never markup.
"""
