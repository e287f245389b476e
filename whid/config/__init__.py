"""Configs: one YAML file → one frozen `Study`, every fault at once, each with its line."""
