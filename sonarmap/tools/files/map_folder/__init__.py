"""The folder that `sonarmap map` writes: its file names, and reading the map from it."""
