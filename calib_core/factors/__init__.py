"""What a measurement says of the unknowns, with its Jacobians: the IMU's links (imu.py), points on planes (lidar_plane.py)."""
