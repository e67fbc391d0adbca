"""Figures as PNG files; one module per figure, one look for all (style.py)."""
