"""Write bags as MCAP files and rosbag2 folders."""
COMPRESSIONS = ('zstd', 'lz4', 'none')
