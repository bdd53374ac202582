"""Where the right pose is lost between the first rotations and the answer."""
