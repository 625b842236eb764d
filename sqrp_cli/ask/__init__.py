"""Questions: words of a command line, values of Python and messages come in, one frozen request goes out."""
