"""Time simulation: the compiled event-driven engine, sensors, the sampled closed loop, batches, the slow reference."""
