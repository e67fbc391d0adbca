"""Files of other programs -> recordings."""
