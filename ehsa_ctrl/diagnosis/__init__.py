"""Where the gap between a rig and its simulation lies, which effect causes it, and how far it shrinks.

`diagnose` runs the stages; each has a file or a few:

- the model of all hypotheses and the scored segments of a log: hypothesis_model, validation_segment, signals
- hypotheses and their fits: candidate_effects, refit, hypothesis_search
- the decision: scoring, model_selection
- the place of the gap, without the catalogue: gap_attribution on unknown_inputs, regressors, regimes, injection,
  place_sets and sensor_error
- the result: causes, improved_plant, verdict_text, diagnosis; and the next experiment: next_experiment on
  model_discrimination and excitation_library

What is known of an effect is in its file in physics/effects, of a machine in plant/systems.
"""
