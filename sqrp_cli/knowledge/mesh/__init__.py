"""Mesh files, looked through before anything loads them, because the loaders believe what a file says of itself."""
