"""The web application: main.py makes it, services.py wires its parts."""
