"""Accuracy and speed, measured against truth, bounds and a committed baseline. `python -m bench --help`."""
