"""Natural elbows, learned from recorded human arms."""
