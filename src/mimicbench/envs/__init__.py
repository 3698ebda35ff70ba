"""Episodes of a task: how they start, run, are observed and judged."""
