"""Lines of multibeam pings: cut into scans, corrected by a map's poses, compared in crossings, and a patch test."""
