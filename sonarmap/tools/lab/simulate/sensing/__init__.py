"""What instruments measure in a scene: a sonar's echoes, multipath and noise, unusable scans, priors of the pose."""
