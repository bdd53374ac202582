"""Lines of pings: from one line to its patches, and from their poses to its navigation."""
