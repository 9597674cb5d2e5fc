"""The planes of a recording as people edit them: pure operations on frozen sets, a history, and the service around."""
