"""What a recording of a real cell says about a program: its motion, its clocks, its cameras and its predictions."""
