"""The command lines of the nodes. Nothing here imports ROS before the arguments are read, so help comes at once."""
