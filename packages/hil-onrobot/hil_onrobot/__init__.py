"""OnRobot force-torque sensors HEX-E and HEX-H, as a plug-in of hil-bridge."""
