"""Recordings: how they come in, what is kept of them, what is shown of them before anything is solved."""
