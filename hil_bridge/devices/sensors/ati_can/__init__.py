"""The bridge's room for an ATI NETCANOEM board."""
