"""The cell that a program runs in: today a simulation in MuJoCo, physics and camera images."""
