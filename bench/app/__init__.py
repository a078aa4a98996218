"""Measure the app in a browser."""
