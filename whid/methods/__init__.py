"""Identification methods: each reads like its paper; one file a method, the folder is the registry."""
