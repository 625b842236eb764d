"""What the operating system gives: files, memory, interrupts and processes."""
