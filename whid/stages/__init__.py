"""Stages: pure estimators, one a file: arrays in, a NamedTuple of the stage's own name out, with standard errors."""
