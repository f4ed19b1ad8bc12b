"""What a linear loop is like: poles, margins, robustness, step responses, exactly sampled."""
