"""The page of `sonarmap live`, which shows the growing map in a browser.

In: messages that the mapping publishes (`messages.py`). Out: a page and its WebSocket (`server.py`), which sends each
browser the messages that it does not have yet, and at the end the report that it was given. No other file is served:
the page is joined once from the scripts here and the report's, in one scope. `view.js` keeps what was received and
draws it, `live.js` shows the plan and the rest.
"""
