"""Registrations in; pose graph, loop closures and map out."""
