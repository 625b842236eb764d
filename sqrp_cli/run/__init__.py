"""A program and a cell come in; events, evidence of images, alarms, retries and a report go out."""
