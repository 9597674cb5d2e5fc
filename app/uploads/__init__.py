"""Resumable uploads (tus 1.0): how bytes come in, are kept, and are known to be the ones that were sent."""
