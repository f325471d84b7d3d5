"""``grade``: compare answers to the contest problem CUMCM 2024 A with the true answers and with reproduced mistakes."""
