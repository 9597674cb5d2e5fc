"""Arrays on disk: what a worker reads or computes once, and the server shows many times without copying."""
