"""Results of the pipeline: result.json as defined by its contract, and result tables."""
