"""Containers: ROS 1 bags, ROS 2 folders and files, mcap, archives, and what can be saved of damaged ones. Start at opening.py."""
