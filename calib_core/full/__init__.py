"""The default method (`--method full`): calibrate.py is the page, its stages are the folders."""
