"""Bags, written: MCAP files and rosbag2 folders."""
