"""A sonar that sends over the loopback, and recordings of what it sends."""
