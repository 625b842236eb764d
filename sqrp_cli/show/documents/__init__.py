"""What leaves the program as JSON: a typed record per document, for other programs, pages and tests alike."""
