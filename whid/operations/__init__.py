"""Column operations: from measured columns to a Record; one file each, the folder is the registry."""
