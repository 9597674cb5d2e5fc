"""The routes, a file a noun: what goes in and out is in app/schemas, what is done in a service. Start at recordings.py."""
