"""ROS 2 without ROS: records of a run as its messages, and bags of others as recordings. Needs the extra `ros`."""
