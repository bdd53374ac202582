"""Where the sensor goes: paths through each scene, and the poses of surveys, dives and the paper's tables on them."""
