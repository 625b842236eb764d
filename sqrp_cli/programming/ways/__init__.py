"""The ways of doing one thing: which there are, and which the cameras see best."""
