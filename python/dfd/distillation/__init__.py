"""From pictures to a field: targets, smoothing, thickness, the learned metric, the fit, and what keeps them."""
