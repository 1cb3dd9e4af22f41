"""Universal Robots' RTDE and the related interfaces: the dashboard server, the script port, and the primary and
real-time interfaces.
"""
