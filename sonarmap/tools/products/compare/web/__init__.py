"""The page of a comparison: HTML, CSS and plain JavaScript, which `page.py` joins with the report's scripts."""
