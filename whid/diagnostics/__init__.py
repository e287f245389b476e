"""Diagnostics: what a residual shows, one statistic a file; arrays in, a statistic, its p and where it lives out."""
