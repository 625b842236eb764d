"""Where cameras should go: what each mount sees, and the best choice with a proof; knows no files."""
