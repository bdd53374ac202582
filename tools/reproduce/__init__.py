"""The paper's experiments on simulated scans: one file per experiment, and what they share."""
