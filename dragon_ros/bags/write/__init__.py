"""Writing bags: MCAP files and rosbag2 folders."""
