"""Identification of the bias polynomial (and, with a rate table, of the scale factor) from a recording."""
