"""From logs to parameters: preparation, estimates, uncertainty, validation and experiment design."""
