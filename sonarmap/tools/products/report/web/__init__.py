"""The page itself: HTML, CSS and plain JavaScript, joined by `page.py` in the order of its `SCRIPTS`.

The scripts share one scope: `map` shows the map in 3D, `ties.js` is what the user decides, the rest the sections below.
`elements.js` makes every element, and texts are never markup.
"""
