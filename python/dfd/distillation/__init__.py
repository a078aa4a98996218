"""Fit a field to pictures: targets, smoothing, thickness, the learned metric, and the fit."""
