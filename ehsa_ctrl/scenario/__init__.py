"""Scenarios: a simulation, a regression test and a section of a report in one definition."""
