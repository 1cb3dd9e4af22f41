"""Many runs: campaigns, tuning, the paper's experiments, clients judged, and the processes that work them off."""
