"""What vehicles record: ROS 1 bags, ROS 2 bags (SQLite and MCAP) and MCAP, message by message (see `open.py`)."""
