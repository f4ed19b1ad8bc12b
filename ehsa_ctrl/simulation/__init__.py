"""Time simulation: the compiled event-driven engine, sensors, sampled closed loops, batches, the slow reference."""
