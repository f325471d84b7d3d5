"""The chain: benches and handles, the law of the leader, and the positions of all followers."""
