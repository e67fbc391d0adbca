"""One module per command; see wineglass.cli for what a module defines."""
