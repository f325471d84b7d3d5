"""The cost of accuracy and effects: the named hard cases, and the pages that measure them."""
