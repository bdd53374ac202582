"""A benchmark's result as a table, as a page and a picture, and beside an older one."""
