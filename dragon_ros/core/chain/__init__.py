"""The chain: benches and their handles, the leader's law, and the positions of all followers."""
