"""The plant as a co-simulation FMU (FMI 2.0): another tool keeps the clock, the engine of `simulate` runs inside."""
