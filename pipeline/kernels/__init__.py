"""Loops over arrays, compiled by numba: arrays and scalars in, arrays out, nothing of ours imported."""
