"""What runs the pipeline: commands, flow, service."""
