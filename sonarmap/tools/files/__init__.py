"""What a file says and gets: readers and writers, what is in a map's folder, and where it lies on the Earth."""
