"""The blind check: diagnose recordings whose cause is withheld."""
