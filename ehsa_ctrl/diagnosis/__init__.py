"""Diagnosis: where a rig differs from its simulation, which effect is the cause, and how much of the gap it closes.

`diagnose` runs these stages:

- model of all hypotheses, and segments of the logs: prepared_logs, hypothesis_model, records, validation_segment,
  split, together, signals
- candidate effects and their fits: candidate_effects, refit, hypothesis_search
- choice of the causes: scoring, model_selection
- place of the gap, independent of the catalogue of effects: gap_attribution, with unknown_inputs, regressors, regimes,
  injection, place_sets, sensor_error
- result: causes, improved_plant, verdict_text, diagnosis
- proposed experiment: next_experiment, with model_discrimination and excitation_library

diagnose.py, batch.py, changed.py and closed_loop.py are the entry points: one log or several together, many logs, two
logs of one rig, and the effect of a diagnosis on a closed loop. Everything specific to an effect is in its file in
physics/effects, everything specific to a machine in plant/systems.
"""
