"""Lidar odometry: the planes followed from scan to scan, without the IMU."""
