"""The contest problem behind the paper: its tables and its result files."""
