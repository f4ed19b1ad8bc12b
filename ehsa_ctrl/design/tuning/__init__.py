"""Automatic tuning of PID gains."""
