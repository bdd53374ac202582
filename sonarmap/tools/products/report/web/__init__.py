"""The page itself: HTML, CSS and plain JavaScript, joined by `page.py` in the order of its `SCRIPTS`, in one scope.

`map_view.js` draws the map in 3D by `scene.js` (WebGL), for the report's `view.js` and for the live page. `packed.js`
has the layout of the points' bytes; `ties.js` holds the user's decisions, `sections.js` the sections below the map.
`elements.js` makes every element; texts are never markup.
"""
