"""Universal Robots' RTDE, and what stands beside it: the dashboard's lines and programs on the script port."""
