"""What a worker process does for each kind of job: thin steps around calib_core.api that leave files behind."""
