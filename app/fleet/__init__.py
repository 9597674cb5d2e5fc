"""Many recordings: found, handed to processes here or on a cluster, and their documents gathered in one folder."""
