"""IMU messages to readings in SI units. Start at readings.py."""
