"""The checker of first-contact certificates. It stands alone: it imports nothing of the package's other rooms."""
