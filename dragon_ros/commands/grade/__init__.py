"""``grade``: compare answers to the contest problem CUMCM 2024 A with the truth and with reproduced mistakes."""
