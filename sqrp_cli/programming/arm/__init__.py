"""The arm: where its links are, and how to bring its tool somewhere."""
