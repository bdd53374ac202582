"""Readers of recordings of messages: ROS 1 bags, ROS 2 bags (SQLite and MCAP) and MCAP files (see `open.py`)."""
