"""Certificates of first contact and what checks them, with none of the solver's code."""
