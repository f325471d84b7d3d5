"""The measurements of the pages of ``docs/cost``, and the command that writes the pages."""
