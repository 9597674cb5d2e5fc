"""Stamps: which clock, which field, which instant of the sweep. Start at point_time.py."""
