"""The chain: benches and their handles, what leads them, and where all of them are behind their leader."""
