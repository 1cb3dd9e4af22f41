"""Robot arm without a controller: kinematics, servo, motion and work area."""
