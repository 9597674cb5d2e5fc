"""What is kept: records in a store, files in the data directory, none of them half written. Start at store.py and files.py."""
