"""Tests of `tools/readers/navigation`."""
