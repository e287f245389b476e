"""Column operations: what is done to measured columns before they become a Record; one file each, the folder is the registry."""
