"""What a recorder needs besides the bag: a thread that writes, times, and an account of losses."""
