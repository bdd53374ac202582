"""Clocks of navigation: calendars, Unix, GPS time and TAI in UTC; how far they are from the scans', and why."""
