"""Recordings of ROS and MCAP, written by other libraries."""
