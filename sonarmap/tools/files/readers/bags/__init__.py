"""What vehicles record: ROS 1 bags, ROS 2 bags (SQLite and MCAP) and MCAP, message by message.

`open.py` opens any of them as a `Recording`; messages of clouds, odometry and transforms are decoded in the
files of these names. The libraries that read them are imported where they are used.
"""
