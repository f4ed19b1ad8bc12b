"""State-space design: design model, Kalman filter, regulator, and the laws of state feedback and MPC."""
