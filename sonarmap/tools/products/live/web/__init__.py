"""The page: HTML, CSS and plain JavaScript, joined by `page.py` with the report's scripts, in one scope.

`dive.js` holds what was received, `clouds.js` and `view.js` draw it, `coverage.js` the plan, `live.js` the rest.
"""
