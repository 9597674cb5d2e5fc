"""Jobs: who waits, a process for each, what it says, how it ends. Start at service.py."""
