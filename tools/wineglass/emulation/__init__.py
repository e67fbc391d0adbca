"""The firmware on emulated processors: driven over a stream, compared with the host, its instructions counted."""
