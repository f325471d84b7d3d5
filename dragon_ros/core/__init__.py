"""The pure model: numpy and shapely, no ROS, no files. Start reading in ``step.py``."""
