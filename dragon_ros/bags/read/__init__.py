"""Read bags, including damaged ones, in bounded memory."""
