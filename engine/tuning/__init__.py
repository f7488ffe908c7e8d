"""Cost-weight configurations: weights, presets, assignments."""
