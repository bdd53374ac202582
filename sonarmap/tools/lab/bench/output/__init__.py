"""A benchmark's result as a table, as JSON, as a page and a picture, and beside an older one."""
