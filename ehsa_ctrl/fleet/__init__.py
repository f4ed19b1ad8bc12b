"""Fleets: many rigs of one make, each with logs of several days.

- `manifest` finds the logs, their rigs and dates. `score` says what one log shows of every parameter and effect, in
  about a second. `store` keeps it, one part per log, and answers queries from the `tables`.
- Over the fleet: `changes` of single rigs, `outliers` from the first log on, `drifts` of parameters, and the fleet's
  own mean and spread by `random_effects`. `rig_diagnosis` diagnoses the rigs that changed in full.
- `analyse` runs all of it; the `result` is a `Fleet`, and `fleet_plant` is a plant with its parameters. `virtual`
  simulates a fleet whose changes are known.
"""
