"""The commands, chapter by chapter: options in, one call, a result out."""
