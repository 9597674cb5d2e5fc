"""An IMU's readings: put on their rows, interpolated, integrated, without its own errors. Start at preintegration.py."""
