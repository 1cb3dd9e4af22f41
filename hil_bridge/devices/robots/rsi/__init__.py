"""KUKA robots with the Robot Sensor Interface."""
