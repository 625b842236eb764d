"""One run of a program: command, images, evidence, verdict, alarm, recovery, retry."""
