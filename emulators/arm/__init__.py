"""A robot arm without a controller: kinematics, servo, motion, work area."""
