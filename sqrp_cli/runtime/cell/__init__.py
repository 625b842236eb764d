"""What stands for the real cell: today a simulation in MuJoCo, physics and camera images."""
