"""``grade``: answers to the contest problem CUMCM 2024 A against the truth, and against remade mistakes."""
