"""Reading and writing of rosbag2 folders, MCAP, sqlite, CSV and NPZ files, without ROS."""
