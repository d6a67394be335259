"""The answer: result.json as defined by its contract, result tables, and their sentences."""
