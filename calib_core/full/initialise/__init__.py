"""Start values in closed form: time offset, rotation, gravity, lever arm."""
