"""Before anything is estimated: spans left out, when the IMU's readings were taken, how noisy they are."""
