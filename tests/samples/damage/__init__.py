"""Damaged and hostile files of every kind."""
