"""The page itself: HTML, CSS and plain JavaScript, joined by `page.py` in the order of its `SCRIPTS`, in one scope.

The map in 3D is `view.js` on `scene.js` (WebGL) and `packed.js` (the layout of the points' bytes); `ties.js` holds the
user's decisions, `sections.js` the sections below the map. `elements.js` makes every element; texts are never markup.
"""
