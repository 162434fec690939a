"""Learning with the solver: elbow policies, natural elbows from people, kinematic calibration."""
