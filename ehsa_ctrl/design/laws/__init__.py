"""The feedback laws themselves, as text that runs plain or compiled."""
