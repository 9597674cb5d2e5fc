"""The 3D scene of a recording: built as data (build.py), shown by viser (apply.py), picked on source points."""
