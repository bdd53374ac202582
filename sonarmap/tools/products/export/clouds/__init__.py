"""Points in the formats of other programs: those of the map, or every point of every scan, portion by portion."""
