"""Recordings written again with their points moved. Start at rewrite.py."""
