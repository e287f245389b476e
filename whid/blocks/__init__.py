"""Blocks: each turns a signal into a signal; one file a block, the folder is the registry (`whid kinds`)."""
