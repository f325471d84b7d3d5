"""The shift map: all handles of a block of equal links at once, as products of small matrices."""
