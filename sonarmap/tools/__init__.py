"""Everything that touches the world, in wings, each built on those before it.

`files`: what a file says and gets. `methods`: which methods of registration there are. `products`: what becomes of a
finished map. `lab`: simulator, scores, experiments, benchmarks. `command`: what the user asks for.
"""
