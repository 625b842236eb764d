"""What cameras see from every pose within stated bounds of their own: surely, or possibly."""
