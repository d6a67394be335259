"""The paper's own tables and figures, made again: evidence, not product."""
