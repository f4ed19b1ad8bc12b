"""A scenario that takes little time: a move of 5 mm within 0.3 s."""

SHORT = """\
schema = 1
title = "A short move"
why = "Tests need a run that takes little time."
plant = "ehsa"
controller = "pid_position"
duration = "1.2 s"

[reference]
kind = "moves"
times = ["0.1 s"]
positions = ["5 mm"]
durations = ["0.3 s"]
"""
LIMITS = '\n[limits]\nMaxError = { max = "3 mm" }\n'
