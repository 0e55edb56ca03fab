"""Recordings: rosbag2 folders, MCAP, sqlite, CSV and NPZ files, read and written without ROS."""
