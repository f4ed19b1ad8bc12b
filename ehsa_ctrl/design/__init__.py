"""Control design: linear models in, controllers out. Knows neither the nonlinear plant nor the simulator."""
