"""The web application: services.py wires its parts, app/application.py makes it of them and the routes."""
