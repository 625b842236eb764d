"""One thin module per command: options in, one call, a result out."""
