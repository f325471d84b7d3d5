"""The chain: benches and their handles, the law of their leader, and the positions of all handles behind it."""
