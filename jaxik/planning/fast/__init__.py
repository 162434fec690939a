"""The fast planner: joint motion of many paths at once, in float32, within a thousandth of a plan's time."""
