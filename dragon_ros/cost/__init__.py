"""What accuracy and effects cost: the named hard cases, and the pages that measure them."""
