"""What leaves the pipeline: result.json as the campaign contract words it, and result tables."""
