"""Parsers of point cloud formats, one file per format: from a file's bytes to clouds that are not checked yet."""
