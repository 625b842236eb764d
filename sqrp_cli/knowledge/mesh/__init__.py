"""Mesh files, checked before they are loaded, because the loaders trust the numbers in a file."""
