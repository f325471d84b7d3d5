"""The contest problem behind the paper: the paper's tables and the contest's result files."""
