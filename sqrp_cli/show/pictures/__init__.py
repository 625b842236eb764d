"""Pictures of what a camera sees, drawn without a graphics card."""
