"""The page of `sonarmap live`: what is mapped so far, in a browser, while the vehicle dives.

In: messages that the mapping publishes (`messages.py`). Out: a page and its WebSocket (`server.py`), which gives every
browser what it still lacks. No file is served: the page is joined once from the scripts here and the report's, in one
scope. `view.js` holds what was received and draws it, `live.js` shows the plan and the rest.
"""
