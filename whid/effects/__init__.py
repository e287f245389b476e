"""Effects: what a model may be missing; one file an effect, the folder is the registry."""
