"""Disturbances: random or periodic things that are not blocks; one file each, the folder is the registry."""
