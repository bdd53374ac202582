"""One file per format of multibeam echo sounders: from a recorded file to a `RecordedLine`, where its soundings lie
in the level frame of each ping. A new format is a file here and a row of FORMATS in `line_file.py`."""
