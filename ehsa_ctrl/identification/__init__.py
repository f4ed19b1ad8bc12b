"""Identification of parameters from logs, and design of experiments for it.

- Logs: `plant_log` reads a log for a plant, `preparation` resamples, shifts and cuts it, `checks` finds faults in it
  (`sample_checks` in single channels, `free_run_checks` against a simulation). `comparison` simulates it in free run
  with the `logged_inputs` from the `initial_state`.
- `identify` runs these stages: start values from `balances` (with `balance_signals` and `balance_regression`);
  a `multi_start` search, first over short windows (`window_stage`), then over whole logs; `uncertainty` and
  `residual_tests`; free runs before and after. Its result is in `identification`, with `identification_text`.
- A fit is `gauss_newton` on the `residuals` of `shooting` windows, whitened by `innovations`; its result is in
  `fit_result`, its `parameters` have bounds and priors. `refits` repeats it with one parameter held at another value.
- `plant_toml` writes the identified plant.
- `experiment` designs an input: `input_search` compares `input_shapes` within the plant's limits (`input_limits`) by
  their `predicted_accuracy`.
"""
