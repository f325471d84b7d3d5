"""Bags, read in bounded memory, damaged ones too."""
