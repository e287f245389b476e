"""Experiment parts: what the input does, planned or found in a record; one file a part, the folder is the registry."""
