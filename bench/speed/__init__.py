"""Measure the speed of `dfd`, and compare it with the limits of the machine and with other libraries."""
