"""From images to evidence: what each camera shows of each box. Nothing here ever sees the simulator."""
