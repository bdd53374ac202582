"""The simulator: scenes made of solids, a ray-cast sonar, noise, trajectories, and the truth beside scans."""
