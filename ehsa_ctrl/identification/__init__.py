"""From logs to parameters, and from parameters to experiments.

A log is read for a plant (`plant_log`), prepared (`preparation`) and checked (`checks`, with `sample_checks` for single
channels and `free_run_checks` against a simulation). `comparison` simulates it in free run with the `logged_inputs`,
from the state that `initial_state` finds.

`identify` is a line of stages, each with a frozen result: start values from `balances` (signals in `balance_signals`,
least squares in `balance_regression`); a `multi_start` search, first over short windows (`window_stage`), then over
the logs; `uncertainty` and `residual_tests`; free runs before and after; `identification`. One fit is `gauss_newton` on
the `residuals` of `shooting` windows, whitened by `innovations`; its result is in `fit_result`. `refits` repeats it
with one parameter held elsewhere. `plant_toml` writes the identified plant.

`experiment` designs an input: `input_search` compares `input_shapes` within the plant's limits (`input_limits`) by
their `predicted_accuracy`.
"""
