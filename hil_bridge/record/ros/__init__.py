"""ROS 2 support without a ROS installation: export of records as messages, import of bags. Requires the extra `ros`."""
