"""The simulated cell: physics and camera images. The only place that knows MuJoCo."""
