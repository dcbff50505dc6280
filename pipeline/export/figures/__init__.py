"""Figures for a paper: vectors with their fonts inside, the map as an image, the same bytes every time."""
