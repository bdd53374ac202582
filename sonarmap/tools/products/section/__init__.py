"""What surveyors take from a finished map: sections along a line, and volumes."""
