"""State-space design: the sampled design model, Kalman filter, regulator, target."""
