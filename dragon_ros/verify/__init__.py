"""The checker of first-contact certificates. It imports nothing from the rest of the package."""
