"""KUKA robots by the Robot Sensor Interface."""
