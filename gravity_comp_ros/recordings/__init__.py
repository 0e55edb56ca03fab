"""Reading and writing of rosbag2 folders, MCAP, sqlite, CSV and Parquet files, without ROS."""
