"""unsweep's web application and command line. It knows calib_core; calib_core does not know it."""
