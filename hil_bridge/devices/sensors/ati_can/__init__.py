"""ATI NETCANOEM board."""
