"""The measurements for the pages in ``docs/cost``, and the command that writes these pages."""
