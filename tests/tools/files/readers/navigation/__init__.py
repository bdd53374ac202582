"""Tests of `tools/files/readers/navigation`."""
