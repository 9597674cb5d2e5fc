"""One message's points, whatever wrote them. Start at decoders.py."""
