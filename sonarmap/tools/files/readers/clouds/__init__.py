"""One file per format of point clouds: from a file's bytes to clouds, before their points are checked (`cloud.py`)."""
