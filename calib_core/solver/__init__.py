"""The descent (levenberg.py) on equations shaped like an arrow (arrow.py), and what they leave unknown (information.py)."""
