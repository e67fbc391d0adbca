"""What `./wineglass test` checks: the list is in steps.py."""
