"""Analysis of sampled linear loops: poles, margins, robustness, step responses."""
