"""ATI NETCANOEM boards."""
