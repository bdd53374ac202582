"""Whole surveys decided again from registrations that are kept: what a rule of the graph is worth, in minutes."""
