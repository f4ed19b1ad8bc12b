"""Figures and HTML; never runs a simulation."""
