"""The elbow policy: a network that corrects the fast planner, its training and its scores."""
