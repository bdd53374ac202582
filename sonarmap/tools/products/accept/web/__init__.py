"""The page's HTML template and its style."""
