"""Merging of similar neighbouring Gaussians, in NumPy, for the receivers with and without torch."""
