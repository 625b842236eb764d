"""The command line: a chapter of commands for each thing that users do."""
