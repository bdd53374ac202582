"""What is in the folder that `sonarmap map` writes: the files' names, and the map read back from them."""
