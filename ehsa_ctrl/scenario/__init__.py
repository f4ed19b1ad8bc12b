"""Scenarios: one definition serves as a simulation, a regression test and a report section."""
