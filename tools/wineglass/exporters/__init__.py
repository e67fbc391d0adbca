"""Recordings -> files of other programs."""
