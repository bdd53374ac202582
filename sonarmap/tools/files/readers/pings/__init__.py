"""Readers of multibeam echo sounders, one file per format: to a `RecordedLine`, whose soundings are in the level
frame of each ping. A new format is a file here and a row of FORMATS in `line_file.py`."""
