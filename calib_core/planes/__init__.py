"""Planes of one cloud (segment.py), and whether two planes are one (same_plane.py)."""
