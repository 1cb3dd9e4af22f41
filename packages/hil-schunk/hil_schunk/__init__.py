"""SCHUNK force-torque sensors FTS behind the interface box IFB-EN, as a plug-in of hil-bridge."""
