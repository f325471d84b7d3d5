"""The contest problem on which the paper is based: the paper's tables and the contest's result files."""
