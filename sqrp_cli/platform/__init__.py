"""The operating system: files, memory, interrupts and processes."""
