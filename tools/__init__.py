"""Everything that touches the world: the command line, files, the simulator, benchmarks."""
