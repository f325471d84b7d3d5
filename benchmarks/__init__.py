"""The pages of ``docs/cost``: what they measure, and how they are written."""
